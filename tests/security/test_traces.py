"""What visitors send and make is gone with the request, the hour, or the server, and takes nobody's place."""

import io
import os
import signal
import threading
import time
from pathlib import Path

from attacking import connect, head, started
from boxes import TRUTH
from PIL import Image

from dipcg.app import limits
from dipcg.app.client import Client
from dipcg.app.store import Store


def test_an_aborted_upload_leaves_nothing(process):
    before = process.files()
    for _ in range(3):
        with connect(process.url) as line:
            line.sendall(head("POST /api/v1/pictures", {"Content-Type": "image/png", "Content-Length": "9000000"}))
            line.sendall(b"x" * 5_000_000)
    # The server has noticed when it has answered somebody else.
    Client(process.url).about()
    assert process.files() == before
    assert open_files(process.process.pid, str(process.folder)) == []


def open_files(pid: int, word: str, seconds: float = 5.0) -> list[str]:
    """Files of a process whose name in /proc has a word, some seconds later at most."""
    until = time.monotonic() + seconds
    while True:
        links = [os.readlink(link) for link in Path(f"/proc/{pid}/fd").iterdir() if link.is_symlink()]
        found = [link for link in links if word in link]
        if not found or time.monotonic() > until:
            return found
        time.sleep(0.1)


def test_the_server_leaves_nothing_when_it_is_stopped(tmp_path, picture):
    with started(tmp_path) as process:
        client = Client(process.url)
        client.build("box", TRUTH, tmp_path / "box.obj")
        client.upload(picture)
        job = client.start_estimate(client.upload(picture), candidates=32)
        watching = threading.Thread(target=lambda: list(client.follow(job)), daemon=True)
        watching.start()
        assert process.files(), "the file that was made is there until then"
        process.process.send_signal(signal.SIGTERM)
        assert process.process.wait(timeout=30) == 0
        assert list(process.folder.iterdir()) == []


def test_a_hundred_calls_take_nobodys_place(address, picture):
    visitor, others = Client(address), Client(address)
    own = visitor.upload(picture)
    job = visitor.start_estimate(own, candidates=1)
    visitor.finish(job)
    for number in range(101):
        others.upload(other_picture(number))
        others.preview("box", TRUTH)
    assert visitor.job(job)["state"] == "done"
    assert visitor.picture(own)


def other_picture(number: int) -> bytes:
    file = io.BytesIO()
    Image.effect_noise((300, 300), 50 + number).save(file, "PNG")
    return file.getvalue()


def test_what_one_visitor_keeps_is_limited_and_what_others_keep_stays():
    gone: list[str] = []
    store: Store[str] = Store(3600.0, most=100, most_of_one=40, drop=gone.append)
    mine = store.add("mine", 10, "me")
    for number in range(20):
        store.add(f"theirs {number}", 10, "they")
    assert gone == [f"theirs {number}" for number in range(16)]
    assert store.get(mine) == "mine"
    crowd = [store.add(f"{name}{i}", 10, name) for name in "abcd" for i in range(4)]
    assert store.get(mine) == "mine", "the most goes from who keeps the most"
    assert len(store) == 10
    assert len(crowd) == 16


def test_what_is_not_used_goes_with_its_time():
    gone: list[str] = []
    store: Store[str] = Store(0.2, most=100, most_of_one=100, drop=gone.append)
    store.add("old", 1, "me")
    kept = store.add("used", 1, "me")
    for _ in range(4):
        time.sleep(0.1)
        assert store.get(kept) == "used"
    assert gone == ["old"]


def test_pictures_of_a_visitor_fit_into_memory(process):
    """However many are sent, and whatever becomes of them."""
    client, before = Client(process.url), process.memory("VmRSS")
    noise = io.BytesIO()
    Image.effect_noise((1000, 1000), 90).convert("RGB").save(noise, "PNG")
    for _ in range(60):
        client.upload(noise.getvalue())
    assert process.memory("VmRSS") - before < 1.5 * limits.PICTURES_OF_ONE / 2**20 + 100
