"""The cache: complete view sets are used again, others never."""

import errno
import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scenes
from scenes.files.digest import digest_of
from scenes.files.errors import InputError
from scenes.modelling.normalise import Similarity
from scenes.modelling.scene import Scene
from scenes.rendering import store
from scenes.rendering.occupancy import NAME
from scenes.rendering.order import NoiseTarget, Order
from scenes.rendering.store import checked_order, is_complete
from scenes.rendering.writer import Standing
from scenes.view_sets.manifest import check_all
from scenes.view_sets.view_set import read_view_set
from tests.scenes.captures import flip
from tests.scenes.loading import TINY, render_tiny

ROOT = Path(scenes.__file__).parents[1]
SPP = dict.fromkeys(("train", "val", "test"), 4)


def test_a_complete_set_is_used_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[Standing] = []
    first = render_tiny(tmp_path, progress=steps.append)
    assert [(step.done, step.total, step.kept) for step in steps] == [(n, 6, 0) for n in range(7)]
    assert first.name.startswith("tiny-16px-")
    assert len(first.name) == len("tiny-16px-") + 12
    check_all(first)
    assert first.stat().st_mode & 0o777 == 0o755
    monkeypatch.setattr(store, "write_view_set", lambda *_: pytest.fail("rendered again"))
    monkeypatch.setattr(store, "choose_variant", lambda *_: pytest.fail("probed"))
    assert render_tiny(tmp_path) == first
    assert render_tiny(tmp_path, variant=None) == first
    assert sorted(path.name for path in tmp_path.iterdir()) == [first.name]


@pytest.mark.parametrize("damage", ["flip", "remove", "manifest", "no manifest"])
def test_damage_is_rendered_again(tmp_path: Path, damage: str) -> None:
    path = render_tiny(tmp_path)
    before = read_view_set(path).test
    victim = path / ("view_set.json" if "manifest" in damage else "test/r_1.exr")
    victim.unlink() if damage in ("remove", "no manifest") else flip(victim)
    assert not is_complete(path)
    assert render_tiny(tmp_path) == path
    assert is_complete(path)
    again = read_view_set(path).test
    assert all(np.array_equal(*pair) for pair in zip(again.rgba, before.rgba, strict=True))
    assert np.array_equal(again.noise_mse, before.noise_mse)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [path.name]


def order_of(scene: Scene, **changes: object) -> Order:
    options: dict[str, object] = {
        "resolution": 8, "counts": {"train": 3, "val": 0, "test": 2}, "spp": SPP, **changes,
    }  # fmt: skip
    return checked_order(scene, **options)  # type: ignore[arg-type]


def test_the_digest_depends_on_everything(monkeypatch: pytest.MonkeyPatch) -> None:
    description = TINY.build()
    base = order_of(TINY)
    moved = {**description, "ball": {**description["ball"], "radius": 0.6000001}}
    vertices = description["floor"]["vertices"].copy()
    vertices[0, 0] = np.nextafter(vertices[0, 0], 2)
    bent = {**description, "floor": {**description["floor"], "vertices": vertices}}
    orders = [
        base,
        replace(base, similarity=Similarity(2.0, (0.0, 0.0, 0.0))),
        order_of(replace(TINY, build=lambda: moved)),
        order_of(replace(TINY, build=lambda: bent)),
        order_of(replace(TINY, max_depth=5)),
        order_of(replace(TINY, view_from="sphere")),
        order_of(replace(TINY, emitters_seen=True)),
        order_of(replace(TINY, box=((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0)))),
        order_of(TINY, resolution=9),
        order_of(TINY, counts={"train": 4, "val": 0, "test": 2}),
        order_of(TINY, spp=SPP | {"test": 5}),
    ]
    digests = [base.digest("llvm_ad_rgb"), *(order.digest("scalar_rgb") for order in orders)]
    assert order_of(TINY).digest("scalar_rgb") == digests[1]
    monkeypatch.setattr("scenes.rendering.order.versions", lambda: {"mitsuba": "9.9.9"})
    digests.append(base.digest("scalar_rgb"))
    assert len(set(digests)) == len(digests)


def test_a_set_that_another_processor_rendered_is_used() -> None:
    """Its matrix products have other last bits of float64, and rounding errors in place of zeros."""

    def elsewhere(value: Any) -> Any:
        if isinstance(value, dict):
            return {key: elsewhere(inner) for key, inner in value.items()}
        if isinstance(value, np.ndarray) and value.dtype == np.float64:
            return np.where(value == 0.0, 1e-17 * np.abs(value).max(initial=0.0), np.nextafter(value, np.inf))
        return value

    turned = {"ball": {"to_world": np.diag([0.3, 0.3, 0.3, 1.0])}}
    description = {**TINY.build(), **turned}
    here, there = (
        order_of(replace(TINY, build=lambda built=built: built)).digest("scalar_rgb")
        for built in (description, elsewhere(description))
    )
    assert here == there


DIGESTS = """
from scenes.rendering.store import checked_order
count = dict.fromkeys(("train", "val", "test"), 2)
for name in ("lego", "ship"):
    print(name, checked_order(name, 8, count, count).digest("scalar_rgb"))
"""


@pytest.mark.slow
def test_placed_bricks_and_normals_by_differences_have_one_name_on_all_processors() -> None:
    """OpenBLAS with the kernels of another processor; where it ignores the choice, both are the same."""

    def names(**environment: str) -> str:
        command = [sys.executable, "-c", DIGESTS]
        environment = {**os.environ, **environment}
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    assert names(OPENBLAS_CORETYPE="Nehalem") == names()


def test_values_that_look_alike_hash_differently() -> None:
    values = [
        1, 1.0, True, "1", None, [1], [[1]], {"1": 1}, {"a": 1, "b": 2}, {"b": 2, "a": 1}, ["ab", "c"], ["a", "bc"],
        np.array([1]), np.array([1.0]), np.array([1.0], np.float32), np.array([[1.0]], np.float32),
    ]  # fmt: skip
    assert len({digest_of(value) for value in values}) == len(values)
    assert digest_of(np.arange(6).reshape(2, 3).T) == digest_of(np.ascontiguousarray(np.arange(6).reshape(2, 3).T))


def test_what_cannot_be_hashed_is_refused() -> None:
    for value in (object(), {"a": lambda: 0}, np.array([object()])):
        with pytest.raises(TypeError, match="plain data"):
            digest_of(value)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"resolution": 100_000}, "resolution 100000"),
        ({"counts": {"train": 101, "val": 0, "test": 0}}, "101 train views"),
        ({"counts": {"train": -1, "val": 0, "test": 0}}, "--train -1"),
        ({"counts": {"train": 0, "val": 0, "test": 0}}, "at least one"),
        ({"counts": {"train": 1}}, "one number each"),
        ({"spp": SPP | {"train": 1}}, "--spp-train 1"),
        ({"spp": SPP | {"train": 10**9}}, "--spp-train 1000000000"),
        ({"spp": SPP | {"test": NoiseTarget(45.0, 1)}}, "--spp-test 1:"),
        *(({"spp": SPP | {"test": NoiseTarget(db, 64)}}, r"--ceiling-test .*choose 10 to 100 dB")
          for db in (5.0, 101.0, float("nan"))),
        ({"variant": "fast"}, "unknown Mitsuba variant"),
    ],
)  # fmt: skip
def test_bad_requests_are_refused(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        render_tiny(tmp_path / "cache", **changes)
    assert not (tmp_path / "cache").exists()


@pytest.mark.parametrize(
    ("number", "message"),
    [
        (errno.ENOSPC, "disk is full"),
        (errno.EROFS, "not writable"),
        (errno.EIO, "cannot"),
    ],
)
def test_a_disk_that_refuses_is_bad_input_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, message: str
) -> None:
    def refuse(file: Path, _: object) -> None:
        raise OSError(number, os.strerror(number), str(file))

    monkeypatch.setattr("scenes.rendering.writer.write_channels", refuse)
    with pytest.raises(InputError, match=f"{message}.*--view-sets"):
        render_tiny(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_way_of_the_cache(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("")
    with pytest.raises(InputError, match="--view-sets"):
        render_tiny(tmp_path / "cache")


def test_a_faster_process_is_not_disturbed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Between the look into the cache and the renaming, another process puts its own set there."""
    plain = store.write_view_set

    def overtaken(partial: Path, order: Order, *rest: object) -> None:
        plain(partial, order, *rest)  # type: ignore[arg-type]
        monkeypatch.setattr(store, "write_view_set", plain)
        faster.append(render_tiny(tmp_path).stat().st_ino)

    faster: list[int] = []
    monkeypatch.setattr(store, "write_view_set", overtaken)
    path = render_tiny(tmp_path)
    assert is_complete(path)
    assert [path.stat().st_ino] == faster  # the folder that was there is still the one
    assert sorted(entry.name for entry in tmp_path.iterdir()) == [path.name]


def test_nothing_is_written_into_a_set_that_is_in_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The leftovers of a killed writer would stay there for ever."""
    plain = store._move_into_place

    def moved(partial: Path, target: Path) -> None:
        plain(partial, target)
        in_place.extend(file.stat().st_mtime_ns for file in (target, target / NAME))

    in_place: list[int] = []
    monkeypatch.setattr(store, "_move_into_place", moved)
    path = render_tiny(tmp_path)
    assert [file.stat().st_mtime_ns for file in (path, path / NAME)] == in_place


def command(cache: Path) -> list[str]:
    return [
        sys.executable, "-m", "scenes", "render", "materials", "--resolution", "24", "--train", "20", "--val", "0",
        "--test", "1", "--spp-train", "4", "--spp-test", "4", "--view-sets", str(cache), "--variant", "scalar_rgb",
    ]  # fmt: skip


@pytest.mark.slow
def test_a_killed_rendering_leaves_nothing_that_is_used(tmp_path: Path) -> None:
    running = subprocess.Popen(command(tmp_path), cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert running.stdout is not None
    assert [json.loads(running.stdout.readline())["done"] for _ in range(2)] == [0, 1]
    running.send_signal(signal.SIGKILL)
    running.wait()
    running.stdout.close()
    left = [path.name for path in tmp_path.iterdir()]
    assert len(left) == 2, "a folder and its lock"
    assert left[0].startswith(".")
    with pytest.raises(InputError):
        read_view_set(tmp_path / left[0])
    done = subprocess.run(command(tmp_path), cwd=ROOT, capture_output=True, text=True, check=True)
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    first = lines[0]
    assert first["done"] == first["kept"] >= 1, "the view of the killed process is kept"
    assert (first["scene"], first["total"], first["share"]) == ("materials", 21, 0.0)
    assert lines[-1]["variant"] == "scalar_rgb"
    assert is_complete(Path(lines[-1]["path"]))
    assert [path.name for path in tmp_path.iterdir()] == [Path(lines[-1]["path"]).name]
    assert done.stderr == ""


def test_a_scene_in_another_unit_is_normalised_and_the_manifest_says_so(tmp_path: Path) -> None:
    counts = {"train": 1, "val": 0, "test": 0}
    result = read_view_set(
        store.ensure_view_set("huge", resolution=8, counts=counts, spp=SPP, cache_folder=tmp_path, variant="scalar_rgb")
    )
    change = result.rendered["normalised"]
    assert change["scale"] == pytest.approx(1e-4, rel=1e-6)
    assert change["shift"] == pytest.approx([-10.0, 10.0, -5.0], abs=1e-5)
    assert np.abs(result.bounds).max() == pytest.approx(1.021, abs=1e-3)
