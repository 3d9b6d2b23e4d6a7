"""The viewer over HTTP: requests of its page and of others."""

import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.records.cells import read_cells
from harness.viewer import engine, server
from harness.viewer.server import FILES, TYPES
from harness.viewer.shown_run import ShownRun
from scenes.files.errors import InputError
from scenes.view_sets.images import read_image
from scenes.view_sets.pixels import over_white
from tests.harness.viewer.conftest import SIZE
from tests.harness.viewer.site import BYTES_PER_PIXEL, ORBIT, Site, unpacked, wanted
from tests.replacing import replace


def test_every_file_of_the_page_is_there_and_may_load_nothing_from_elsewhere(site: Site) -> None:
    for path, name in FILES.items():
        status, headers, body = site.ask("GET", path)
        assert status == 200
        assert headers["content-type"].startswith(TYPES[Path(name).suffix])
        assert b"://" not in body.replace(b"http://www.w3.org/2000/svg", b"")
        policy = dict(part.split(maxsplit=1) for part in headers["content-security-policy"].split("; "))
        assert policy["default-src"] == "'none'"
        assert {policy[name] for name in ("script-src", "style-src", "connect-src", "img-src")} == {"'self'"}
        assert policy["frame-ancestors"] == policy["base-uri"] == policy["form-action"] == "'none'"
        assert headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "localhost@evil", "", "[::2]", "10.0.0.1"])
@pytest.mark.parametrize("path", ["/", "/run.json", "/scene.json?scene=ball"])
def test_another_host_s_name_is_refused(site: Site, host: str, path: str) -> None:
    status, headers, body = site.ask("GET", path, host=host)
    assert status == 400
    assert b"ball" not in body
    if body != b"Invalid HTTP request received.":
        assert "content-security-policy" in headers


@pytest.mark.parametrize("host", ["localhost", "LOCALHOST:1", "127.0.0.1:80", "[::1]:8008"])
def test_this_machine_s_own_names_are_fine(site: Site, host: str) -> None:
    assert site.ask("GET", "/run.json", host=host)[0] == 200


@pytest.mark.parametrize(
    ("method", "path", "status"),
    [
        ("GET", "/nothing", 404), ("GET", "/../options.py", 404), ("GET", "/page/viewer.js", 404),
        ("GET", "/render", 405), ("PUT", "/render", 405), ("OPTIONS", "/render", 405), ("GET", "/scene.json", 400),
        ("GET", "/scene.json?scene=..%2F..", 400), ("GET", "/truth?scene=ball", 400),
        ("GET", "/truth?scene=ball&view=3", 400), ("GET", "/truth?scene=ball&view=99999999", 400),
        ("GET", "/truth?scene=ball&view=%D9%A1", 400), ("GET", "/truth?scene=nothing&view=0", 400),
    ],
)  # fmt: skip
def test_there_is_nothing_else(site: Site, method: str, path: str, status: int) -> None:
    answered, headers, body = site.ask(method, path)
    assert answered == status
    assert b"Traceback" not in body
    assert "content-security-policy" in headers


BAD: list[tuple[dict[str, Any], str]] = [
    ({"scene": "<b>"}, "scene"), ({"methods": ["nerf", "nothing"]}, "methods"), ({"methods": []}, "methods"),
    ({"methods": ["nerf", "nerf"]}, "methods"), ({"methods": [str(i) for i in range(9)]}, "methods"),
    ({"place": {"view": 3}}, "view"), ({"place": {"view": -1}}, "place"), ({"place": {"view": 0.5}}, "place"),
    ({"place": {**ORBIT, "azimuth": float("nan")}}, "NaN"),
    ({"place": {**ORBIT, "distance": float("inf")}}, "Infinity"), ({"place": {**ORBIT, "distance": 0}}, "distance"),
    ({"place": {**ORBIT, "target": [0, 0]}}, "target"), ({"place": {**ORBIT, "roll": 0}}, "place"),
    ({"width": 10**6}, "width"), ({"width": 0}, "width"), ({"generation": -1}, "generation"),
    ({"client": "x" * 500}, "client"), ({"more": 1}, "more"),
    ({"attention": {"kind": "all", "row": 0, "column": 0}}, "kind"),
    ({"attention": {"kind": "point", "row": 2, "column": 0}}, "row"),
]  # fmt: skip


NO_JSON = (b"", b"[1", b"\xff", b"[" * 4000)
NO_REQUEST = [
    *((body, "not JSON") for body in NO_JSON),
    (b"[]", "the request"),
    (b'{"a": ' + b"1" * 5000 + b"}", "4096 bytes"),
    (wanted().replace(b"4.0", b"1e999"), "distance"),
    *((wanted(**changes), words) for changes, words in BAD),
]


@pytest.mark.parametrize(("body", "words"), NO_REQUEST)
def test_a_bad_request_is_refused_with_a_sentence(site: Site, body: bytes, words: str) -> None:
    status, _, answer = site.ask("POST", "/render", body, content_type="application/json")
    assert status == 400
    assert words in answer.decode()
    assert len(answer) < 300


def test_other_pages_may_not_ask(site: Site) -> None:
    """Without the JSON type a browser would send it for any page, unasked."""
    for headers in ({"content_type": "text/plain"}, {}):
        assert site.ask("POST", "/render", wanted(), **headers)[0] == 415
    for origin in ("http://evil.example", "null", f"http://localhost:{site.port}"):
        assert site.ask("POST", "/render", wanted(), content_type="application/json", origin=origin)[0] == 403
        assert site.ask("GET", "/truth?scene=ball&view=0", origin=origin)[0] == 403
    for path in ("/", "/run.json", "/scene.json?scene=ball", "/truth?scene=ball&view=0"):
        assert site.ask("GET", path, sec_fetch_site="cross-site")[0] == 403
        assert site.ask("GET", path, sec_fetch_site="same-origin", origin=site.address.rstrip("/"))[0] == 200
    assert site.ask("GET", "/", sec_fetch_site="none")[0] == 200


def test_a_request_that_never_comes_is_not_waited_for(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "BODY_SECONDS", 0.2)
    head = "POST /render HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 9\r\n\r\n{"
    with socket.create_connection(("127.0.0.1", site.port), timeout=60) as line:
        line.sendall(head.encode())
        assert b" 408 " in line.recv(65536).partition(b"\r\n")[0]
    assert site.messages()[-1][0]["kind"] == "end"


def test_a_test_view_is_scored_as_the_run_scored_it(site: Site, trained: Path) -> None:
    recorded = {cell.method: [view.psnr for view in cell.views] for cell in read_cells(trained)}
    for view in range(3):
        messages = site.messages(place={"view": view}, attention={"kind": "none", "row": 0, "column": 0})
        last = {header["method"]: header for header, _ in messages if header.get("state") == "whole"}
        for method in ("nerf", "qnerf"):
            assert last[method]["psnr"] == pytest.approx(recorded[method][view], abs=1e-9)
        start = next(header for header, _ in messages if header["kind"] == "start")
        assert (start["exact"], start["width"], start["height"]) == (view, SIZE, SIZE)


def test_a_free_camera_has_no_score(site: Site) -> None:
    views = site.json("/scene.json?scene=ball")["views"]
    place = {name: views[1][name] for name in ORBIT}
    messages = site.messages(place={**place, "azimuth": place["azimuth"] + 0.1})
    start = next(header for header, _ in messages if header["kind"] == "start")
    assert start["exact"] is None
    frames = [header for header, _ in messages if header["kind"] == "frame"]
    assert frames
    assert {frame["psnr"] for frame in frames} == {None}
    assert (messages[-1][0]["kind"], messages[-1][0]["cache"]["memory_alone"]) == ("end", "")


def test_a_stream_holds_every_pixel_and_the_second_time_the_cached_picture(site: Site) -> None:
    place = {**ORBIT, "azimuth": 2.0}
    pictures = []
    for cached in (None, "memory"):
        messages = site.messages(place=place, methods=["nerf"])
        shown = [(header, body) for header, body in messages if header["kind"] == "frame"]
        whole, last = np.zeros((SIZE * SIZE, 3), np.uint8), shown[-1][0]
        for header, body in shown:
            count = header["pixels"]
            assert len(body) == BYTES_PER_PIXEL * count
            colour = np.frombuffer(body[8 * count : 11 * count], "u1").reshape(-1, 3)
            whole[np.frombuffer(body[: 4 * count], "<u4")] = colour
        assert last["state"] == "whole"
        assert last["cached"] == cached
        pictures.append(whole)
    assert np.array_equal(*pictures)
    assert len(np.unique(pictures[0])) > 10


def test_the_ground_truth_is_the_stored_image(site: Site, trained: Path) -> None:
    status, _, body = site.ask("GET", "/truth?scene=ball&view=2")
    [(header, pixels)] = unpacked(body)
    assert (status, header["name"], header["has_depth"]) == (200, "test/r_2", False)
    stored = over_white(read_image(trained.parent / "ball/test/r_2.png"))
    count = SIZE * SIZE
    colour = np.frombuffer(pixels[8 * count : 11 * count], "u1").reshape(SIZE, SIZE, 3)
    assert np.abs(colour / 255.0 - stored).max() <= 0.5 / 255 + 1e-6


def test_a_method_without_a_checkpoint_says_so_and_the_others_are_shown(site: Site) -> None:
    messages = site.messages(methods=["nerf_matched", "nerf"])
    failed = [header for header, _ in messages if header["kind"] == "failed"]
    assert [header["method"] for header in failed] == ["nerf_matched"]
    assert "was not trained" in failed[0]["note"]
    assert any(header.get("state") == "whole" and header["method"] == "nerf" for header, _ in messages)
    alone = site.messages(methods=["nerf_matched"])
    assert [header["kind"] for header, _ in alone if header["kind"] != "loading"] == ["failed", "end"]


def test_an_error_of_ours_is_said_and_the_next_request_is_fine(
    site: Site, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(engine, "frames", lambda *_, **__: iter([None]))
        messages = site.messages()
        assert messages[-1][0]["kind"] == "broken"
        assert "AttributeError" in messages[-1][0]["note"]
    assert "AttributeError" in capsys.readouterr().err
    assert site.messages()[-1][0]["kind"] == "end"
    assert site.ask("GET", "/run.json")[0] == 200


def test_test_views_of_another_rendering_are_no_ground_truth(shown: ShownRun) -> None:
    scene = shown.run.run.scenes[0]
    views = shown.run.views(scene, train=2, geometry=False)
    assert (len(views.train.names), len(views.test.names), views.width) == (2, 3, SIZE)
    other = replace(scene, rendered={"digest": "of another one"})
    with pytest.raises(InputError, match="another rendering than the one that ball was trained on"):
        shown.run.views(other)
    assert "another rendering" in shown.truth(other).missing
