"""A render that was abandoned ends after its current chunk of rays."""

import socket
import time
from contextlib import ExitStack
from typing import Any

import pytest

from harness.viewer import engine, server
from harness.viewer.server import MOST_STREAMS
from tests.harness.patching import preceded
from tests.harness.viewer.site import ORBIT, Site, wanted


@pytest.fixture
def calls(site: Site, monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The calls of rays of nerf, each of which takes a while."""
    made: list[Any] = []
    seat = site.worker.submit(site.shown.method_view, site.shown.scene("ball"), "nerf").result()
    refine = engine.refine

    def wait(*arguments: Any) -> None:
        made.append(arguments)
        time.sleep(0.15)

    preceded(monkeypatch, seat.learner, "render", wait)
    monkeypatch.setattr(engine, "refine", lambda *rest: refine(*rest, least_rays=1))
    return made


def began(site: Site, calls: list[Any], **changes: Any) -> socket.socket:
    line, before = socket.create_connection(("127.0.0.1", site.port), timeout=60), len(calls)
    body = wanted(**{"methods": ["nerf"], **changes})
    head = ["POST /render HTTP/1.1", "Host: localhost", "Content-Type: application/json", "Connection: close"]
    line.sendall("\r\n".join([*head, f"Content-Length: {len(body)}", "", ""]).encode() + body)
    while len(calls) == before:
        time.sleep(0.01)
    return line


def rest_of(line: socket.socket) -> bytes:
    return b"".join(iter(lambda: line.recv(65536), b""))


def settled(calls: list[Any]) -> int:
    """The number of calls, once there are no more."""
    before = -1
    while before != len(calls):
        before = len(calls)
        time.sleep(0.5)
    return before


def test_one_who_leaves_stops_the_rendering(site: Site, calls: list[Any]) -> None:
    with began(site, calls, place={**ORBIT, "azimuth": 3.0}, client="leaves"):
        pass
    assert 1 <= settled(calls) <= 4  # of a coarse frame and nine regions


def test_a_newer_wish_stops_the_older_one_and_other_pages_go_on(site: Site, calls: list[Any]) -> None:
    older, newer = {**ORBIT, "azimuth": 3.1}, {**ORBIT, "azimuth": 3.2}
    with (
        began(site, calls, place=older, generation=70, client="one") as line,
        began(site, calls, place=older, generation=1, client="another") as other,
    ):
        site.messages(place=newer, methods=["qnerf"], generation=71, client="one")
        given_up, whole = rest_of(line), rest_of(other)
    assert b'"state": "coarse"' in given_up
    assert b'"state": "whole"' not in given_up
    assert b'"kind": "end"' not in given_up
    assert b'"kind": "given up"' in given_up
    assert b'"state": "whole"' in whole
    # a request that comes late is no new wish
    assert site.render(place=ORBIT, generation=70, client="one")[0] == 409


def test_no_more_views_are_begun_than_memory_is_for(site: Site, calls: list[Any]) -> None:
    place = {**ORBIT, "azimuth": 3.4}
    with ExitStack() as open_ones:
        for number in range(MOST_STREAMS):
            open_ones.enter_context(began(site, calls, place=place, client=f"page {number}"))
        status, answer = site.render(client="one more")
        assert (status, f"{MOST_STREAMS} views are being rendered" in answer.decode()) == (503, True)
        assert site.ask("GET", "/run.json")[0] == 200
    settled(calls)  # who has left makes room
    for _ in range(MOST_STREAMS + 1):
        assert site.messages(methods=["qnerf"])[-1][0]["kind"] == "end"
        assert site.render(scene="nothing")[0] == 400


def test_a_page_that_is_forgotten_is_told(site: Site, calls: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "MOST_CLIENTS", 1)
    with began(site, calls, place={**ORBIT, "azimuth": 3.5}, client="forgotten") as line:
        assert site.render(methods=["qnerf"], client="another")[0] == 200
        stream = rest_of(line)
    assert b'"kind": "given up"' in stream
    assert b'"kind": "end"' not in stream
