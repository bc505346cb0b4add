"""What is more than the server can do is refused, and costs nobody what is there."""

import threading

import pytest
from boxes import TRUTH

from dipcg.app import jobs
from dipcg.app.client import ApiError, Client
from dipcg.app.desk import Budget
from dipcg.app.jobs import Busy


@pytest.mark.slow
def test_too_many_jobs_are_turned_away_and_the_others_end(address, picture, monkeypatch):
    monkeypatch.setattr(jobs, "MOST_JOBS", 3)
    client = Client(address)
    name, accepted, refused = client.upload(picture), [], 0
    for seed in range(12):
        try:
            accepted.append(client.start_estimate(name, candidates=2, seed=seed))
        except ApiError as error:
            refused += error.status == 503
    assert refused == 12 - len(accepted) > 0
    assert all(client.finish(job)["ranked"] for job in accepted)


def test_a_budget_is_given_back_however_its_use_ends():
    budget = Budget(2)
    with pytest.raises(KeyError), budget.take(2):
        raise KeyError
    with budget.take(1), budget.take(1), pytest.raises(Busy), budget.take(1):
        pass
    with budget.take(2):
        pass


def test_many_previews_at_once_are_all_answered_or_refused(address):
    sizes: list[int] = []

    def ask() -> None:
        sizes.append(len(Client(address).preview("box", TRUTH)))

    threads = [threading.Thread(target=ask) for _ in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(sizes) == 20
    assert len(set(sizes)) == 1
