"""`voxels_drjit` behind the cache, whose weights are Dr.Jit's and not torch's."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from baselines.contract import Box
from harness.plan.settings import VoxelSettings
from harness.playback import keys
from harness.playback.cached import CachedMethod
from harness.playback.store import ViewStore
from harness.training.evaluate import View, render_view
from harness.training.make_learner import learner_for
from tests.harness.playback.drawn import same_bits
from tests.harness.playback.test_view_keys import camera, key
from tests.harness.tiny import BUDGET, CPU, TRAIN, box, rays_and_colours
from tests.harness.voxels import drjit_or_skip

CHUNK = 50
SETTINGS = replace(TRAIN, voxels=VoxelSettings(finest=16, bins=24, smoothed=256))


@pytest.fixture(scope="module", autouse=True)
def available() -> None:
    drjit_or_skip()


def untrained() -> Any:
    return learner_for("voxels_drjit", box(), SETTINGS, BUDGET, 0, CPU)


def trained(steps: int = 3) -> Any:
    one = untrained()
    for step in range(steps):
        one.train_on(*rays_and_colours(seed=step))
    return one


def plain(one: Any) -> View:
    return render_view(one, camera().cameras(CPU), 0, CHUNK)


def same(a: View, b: View) -> bool:
    return all(same_bits(getattr(a, name), getattr(b, name)) for name in ("colour", "opacity", "depth"))


@pytest.mark.parametrize("frozen", [False, True])
def test_from_every_level_the_picture_is_bit_for_bit_the_rendered_one(tmp_path: Path, frozen: bool) -> None:
    one = trained()
    expected = plain(one)
    assert np.ptp(expected.colour) > 0.0
    cached = CachedMethod(one, ViewStore(10**6, tmp_path), CHUNK, frozen)
    assert same(cached.render(camera()), expected)
    fresh = CachedMethod(one, ViewStore(10**6, tmp_path), CHUNK, frozen)
    for method, level in ((cached, 1), (cached, 0), (fresh, 2), (fresh, 1)):
        found = method.lookup(camera())
        assert found is not None
        assert same(found[0], expected)
        assert found[1] == level


FACTS: dict[str, Callable[[Any], None]] = {
    "bins": lambda one: setattr(
        one, "settings", replace(one.settings, voxels=replace(one.settings.voxels, bins=25))
    ),
    "box": lambda one: setattr(one, "box", Box(one.box.lower, one.box.upper + 1e-6)),
    "method": lambda one: setattr(one, "method", "another"),
}  # fmt: skip


@pytest.mark.parametrize("fact", FACTS)
def test_whatever_a_picture_depends_on_is_in_the_key(fact: str) -> None:
    one = untrained()
    before = key(one)
    assert key(one) == before
    FACTS[fact](one)
    assert key(one) != before


def test_dr_jit_its_compiler_and_the_background_are_in_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    one = untrained()
    before = key(one)
    assert one.rendered_by()["background"] == plain_background(one)
    for name, other in (("_drjit", lambda: ["0.0", [1, 2, 3]]), ("processor", lambda: "another")):
        with monkeypatch.context() as patch:
            patch.setattr(keys, name, other)
            assert key(one) != before


def plain_background(one: Any) -> list[float]:
    """What is seen past the box."""
    rays, _ = rays_and_colours(1)
    away = replace(rays, origins=rays.origins * 2.0, directions=-rays.directions)
    colour: list[float] = one.render(away, 1).colour[0].tolist()
    return colour
