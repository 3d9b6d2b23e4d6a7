"""Messages and limits of the renderer, which is a short script here."""

import os
import signal
import stat
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from harness.execution import ground_truth
from harness.execution.ground_truth import render_view_sets, sizes_of, usual_limit
from harness.execution.progress import RenderProgress
from harness.plan.settings import ViewSettings
from scenes.files.errors import InputError

VIEWS = ViewSettings(resolution=8, train=2, val=0, test=2, spp_train=2, spp_test=2)
RENDERER = """#!/bin/sh
echo $$ > {pid}
echo 'output of a user scene'
{lines}
"""


@pytest.fixture
def renderer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    def written(*lines: str) -> None:
        script = tmp_path / "renderer"
        script.write_text(RENDERER.format(pid=tmp_path / "pid", lines="\n".join(lines)), encoding="utf-8")
        script.chmod(script.stat().st_mode | stat.S_IXUSR)
        monkeypatch.setattr(sys, "executable", str(script))

    return written


NEXT = ("train/r_0", "train/r_1", "test/r_0", "test/r_1", "")


def said(done: int, scene: str = "mine") -> str:
    return f"""echo '{{"scene": "{scene}", "done": {done}, "total": 4, "view": "{NEXT[done]}"}}'"""


def ended(scene: str = "mine") -> str:
    return f"""echo '{{"scene": "{scene}", "path": "there/{scene}"}}'"""


def rendered(cache: Path, limit: float | None = None, file: str | None = "mine.py") -> list[RenderProgress]:
    return list(render_view_sets(("mine",), VIEWS, cache, file, limit))


def test_the_view_in_work_is_named_and_what_a_scene_prints_ends_nothing(
    tmp_path: Path, renderer: Callable[..., None]
) -> None:
    deep = tmp_path / "deep"
    deep.write_text("[" * 1_000_000 + "\n", encoding="utf-8")
    renderer(f"cat {deep}", *map(said, range(5)), ended())
    found = rendered(tmp_path)
    assert [one.doing for one in found[:5]] == [
        "view train/r_0", "view train/r_1", "view test/r_0", "view test/r_1", "the end",
    ]  # fmt: skip
    assert found[-1].path == Path("there/mine")


@pytest.mark.parametrize(("lines", "what"), [((), "loading"), ((said(0), said(3)), "view test/r_1")])
def test_what_takes_longer_than_the_limit_is_ended_and_named(
    tmp_path: Path, renderer: Callable[..., None], monkeypatch: pytest.MonkeyPatch, lines: tuple[str, ...], what: str
) -> None:
    now = count()

    def monotonic() -> float:
        """Stand still until all messages are sent, then advance by a second per call."""
        return float(next(now)) if (tmp_path / "said").exists() else 0.0

    renderer(*lines, f"touch {tmp_path / 'said'}", "exec sleep 600")
    monkeypatch.setattr(ground_truth, "time", SimpleNamespace(monotonic=monotonic))
    with pytest.raises(InputError, match=f"^--scene-file mine.py: {what} took more than 1.5 s; .*--render-limit"):
        rendered(tmp_path, limit=1.5)
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text(encoding="utf-8")), 0)


def test_the_limit_is_that_of_one_view_and_not_of_all(
    tmp_path: Path, renderer: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    now = count()
    monkeypatch.setattr(ground_truth, "time", SimpleNamespace(monotonic=lambda: float(next(now))))
    messages: list[dict[str, Any]] = [{"scene": "mine", "done": done, "total": 4} for done in range(5)]
    messages.append({"scene": "mine", "path": "there/mine"})

    def slow(process: Any, _: float) -> Iterator[dict[str, Any] | None]:
        with process.stdout as all_said:
            all_said.read()  # else it is ended for writing where nobody reads
        for message in messages:
            yield from (None, message)

    monkeypatch.setattr(ground_truth, "_messages", slow)
    renderer()
    assert rendered(tmp_path, limit=1.5)[-1].path == Path("there/mine"), "18 s in all"


def test_a_large_view_may_take_longer_and_a_given_limit_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert usual_limit(VIEWS) == usual_limit(replace(VIEWS, resolution=800, spp_test=256)) == 1800.0
    large = replace(VIEWS, resolution=4000, spp_test=256)
    assert usual_limit(large) == pytest.approx(4 * 1.6 * 4096.0)
    given: list[object] = []

    def noted(*arguments: object) -> Iterator[RenderProgress]:
        given.append(arguments[-1])
        return iter(())

    monkeypatch.setattr(ground_truth, "_render", noted)
    for file, limit in (("mine.py", None), ("mine.py", 5.0), (None, None)):
        list(render_view_sets(("mine",), large, tmp_path, file, limit))
    assert given == [usual_limit(large), 5.0, None]


def test_signs_of_life_come_where_nothing_is_finished(
    tmp_path: Path, renderer: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ground_truth, "BEAT_SECONDS", 0.05)
    waits = [f"until [ -e {tmp_path / name} ]; do sleep 0.02; done" for name in ("lego", "mine", "mic")]
    renderer(waits[0], said(0), waits[1], ended("lego"), waits[2], ended("mic"))
    waiting, ends = set(), []
    for one in render_view_sets(("lego", "mic"), VIEWS, tmp_path):
        if " for " in one.doing:
            waiting.add((one.scene, one.doing.partition(" for ")[0]))
            (tmp_path / one.scene).touch()
        elif one.path:
            ends.append(one.scene)
    assert waiting == {("lego", "loading"), ("mine", "view train/r_0"), ("mic", "loading")}
    assert ends == ["lego", "mic"]


def test_what_the_renderer_leaves_behind_holds_nothing_up(
    tmp_path: Path, renderer: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ground_truth, "BEAT_SECONDS", 0.2)
    renderer("sleep 60 &", f"echo $! > {tmp_path / 'child'}", said(4), ended())
    try:
        assert any(one.path for one in rendered(tmp_path, limit=30.0))
        child = int((tmp_path / "child").read_text(encoding="utf-8"))
        os.kill(child, 0)  # it is still there
    finally:
        os.kill(int((tmp_path / "child").read_text(encoding="utf-8")), signal.SIGKILL)


def test_a_renderer_that_the_system_kills_is_told_as_such(tmp_path: Path, renderer: Callable[..., None]) -> None:
    renderer(said(0), "kill -9 $$")
    with pytest.raises(InputError, match=r"mine.py: view train/r_0 was ended by signal 9 \(SIGKILL\), .*memory runs"):
        rendered(tmp_path)


def test_ceilings_are_handed_on_and_fixed_numbers_have_none() -> None:
    assert not any(word.startswith("--ceiling") for word in sizes_of(VIEWS))
    words = sizes_of(replace(VIEWS, ceiling_train_db=30.0, ceiling_test_db=45.5))
    assert words[-4:] == ["--ceiling-train", "30.0", "--ceiling-test", "45.5"]
    assert words[:-4] == sizes_of(VIEWS), "the numbers are the most"


def test_the_samples_of_a_plan_lie_between_those_of_the_easiest_and_the_hardest_scene() -> None:
    assert VIEWS.samples() == (8.0, 8.0)
    needed = replace(VIEWS, spp_train=64, spp_test=256, ceiling_train_db=33.0, ceiling_test_db=45.0)
    assert needed.samples() == pytest.approx((2 * 9.5 + 2 * 95, 2 * 40 + 2 * 256))
