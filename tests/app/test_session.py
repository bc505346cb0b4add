"""The last edit wins: whatever order requests come and end in, the desk shows what the order of asking gives."""

import threading
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from boxes import BOX, TRUTH, VIEW
from gradio import EventData
from hypothesis import given, settings
from hypothesis import strategies as st
from serving import OPEN

from dipcg.app import state as app_work
from dipcg.app.events import Events
from dipcg.app.session import Change, Desk
from dipcg.app.state import Found, Work
from dipcg.workers.process import BuildError

OTHER = BOX.sample(np.random.default_rng(1))
FRESH = Work("box", (Found(OTHER, VIEW),), 0, OTHER)


def set_to(name: str, value: object) -> Change:
    return lambda work: app_work.edited(work, BOX, name, value)


def desk_with(work: Work) -> Desk:
    desk = Desk()
    desk.change(0, lambda _: work)
    return desk


CHANGES = st.sampled_from(
    [set_to("width", value) for value in (0.4, 0.5, 0.6)]
    + [set_to("top", "open"), set_to("has_legs", False), app_work.undone, app_work.reset]
    + [lambda work: app_work.held(work, BOX, "depth"), lambda work: app_work.opened(work, 0)]
    + [lambda work: app_work.replaced(work, FRESH)]
)


@settings(max_examples=50)
@given(st.lists(CHANGES, max_size=8), st.randoms())
def test_any_order_of_arrival_gives_what_the_order_of_asking_gives(changes, random):
    expected = OPEN
    for change in changes:
        expected = change(expected)
    desk, asked = desk_with(OPEN), list(enumerate(changes, 1))
    random.shuffle(asked)
    versions = [desk.change(turn, change)[0] for turn, change in asked]
    assert desk.work == expected
    assert versions == sorted(set(versions))


def test_an_edit_stays_when_an_estimate_asked_before_it_ends_after_it():
    desk = desk_with(OPEN)
    desk.change(2, set_to("width", 0.7))
    desk.change(1, lambda work: app_work.replaced(work, FRESH))
    assert desk.work.params == BOX.replace(OTHER, {"width": 0.7})
    assert app_work.undone(desk.work).params == OTHER


def test_a_change_that_is_refused_leaves_the_desk_as_it_was():
    desk = desk_with(OPEN)
    desk.change(5, set_to("width", 0.7))
    before = desk.work
    for turn in (3, 6):
        with pytest.raises(ValueError, match="width must be"):
            desk.change(turn, set_to("width", 99))
    assert desk.work == before


def test_later_changes_that_no_longer_fit_are_left_out():
    desk = desk_with(OPEN)
    desk.change(2, lambda work: app_work.opened(work, 0))
    desk.change(3, set_to("width", 0.7))
    desk.change(1, lambda work: Work("box", params=OTHER))
    assert desk.work.params == BOX.replace(OTHER, {"width": 0.7})


def test_visitors_get_desks_of_their_own():
    first = desk_with(OPEN)
    assert deepcopy(first).work == Work()


def edit(name: str, value: object) -> EventData:
    return EventData(None, {"name": name, "value": value, "final": True})


def test_an_older_build_that_ends_last_does_not_come_back(studio, downloads, monkeypatch):
    begun, go, answers, build = threading.Event(), threading.Event(), [], studio.build

    def slowly(name: str, params: Any) -> Any:
        if params["width"] == 0.9:
            begun.set()
            assert go.wait(60)
        return build(name, params)

    monkeypatch.setattr(studio, "build", slowly)
    does, desk = Events(studio, downloads, []), desk_with(OPEN)
    first = threading.Thread(target=lambda: answers.append(does.edit(desk, 1, edit("width", 0.9))))
    first.start()
    assert begun.wait(60)
    answers.append(does.edit(desk, 2, edit("width", 0.35)))
    go.set()
    first.join()
    newer, older = answers
    assert desk.work.params == TRUTH | {"width": 0.35}
    for component in (1, 2, 3):  # viewer, panel, command: the page leaves out the lower number
        assert newer[component]["version"] > older[component]["version"]


def test_what_cannot_be_built_is_told_and_can_be_undone(studio, downloads, monkeypatch):
    def fail(*_: object) -> None:
        raise BuildError("raised", "These parameters give no box.")

    does, desk = Events(studio, downloads, []), desk_with(OPEN)
    monkeypatch.setattr(studio, "build", fail)
    with pytest.warns(UserWarning, match="These parameters give no box"):
        _, view, panel, command = does.edit(desk, 1, edit("width", 0.4))
    assert "vertices" not in view
    assert panel["parts"][0]["rows"][0]["value"] == 0.4
    assert "width=0.4" in command["text"]
    monkeypatch.undo()
    assert does.undo(desk, 2)[1]["vertices"]
