"""A method behind the cache gives the pictures that it would give without."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from baselines.contract import Box
from baselines.methods.explicit import VoxelSettings
from harness.playback import cached, keys
from harness.playback.cached import CachedMethod
from harness.playback.store import ViewStore
from harness.training.learner import Job
from harness.training.make_learner import learner_for
from harness.training.scoring.evaluate import View, render_view
from harness.training.trainer import Diverged, Trainer
from tests.harness.ball import pose
from tests.harness.playback.drawn import same_bits
from tests.harness.playback.test_view_keys import CHANGES, camera, key, trained
from tests.harness.tiny import BUDGET, CPU, TRAIN, box, rays_and_colours
from tests.harness.voxels import drjit_or_skip

CHUNK = 50


def plain(learner: Trainer, view: object = None) -> View:
    return render_view(learner, (view or camera()).cameras(learner.device), 0, CHUNK)  # type: ignore[attr-defined]


def same(a: View, b: View) -> bool:
    return all(same_bits(getattr(a, name), getattr(b, name)) for name in ("colour", "opacity", "depth"))


@pytest.fixture
def renders(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Grows whenever something is rendered."""
    calls: list[int] = []

    def counted(*arguments: object) -> View:
        calls.append(len(calls))
        return render_view(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(cached, "render_view", counted)
    return calls


def voxels() -> Any:
    """Return a method whose weights are Dr.Jit's and not torch's."""
    drjit_or_skip()
    settings = replace(TRAIN, own={"voxels_drjit": VoxelSettings(finest=16, bins=24, smoothed=256)})
    learner = learner_for(Job("voxels_drjit", box(), settings, BUDGET, 0, CPU))
    for step in range(3):
        learner.train_on(*rays_and_colours(seed=step))
    return learner


@pytest.mark.parametrize("learned", [trained, partial(trained, "qnerf"), voxels], ids=["nerf", "qnerf", "voxels"])
def test_from_every_level_the_picture_is_bit_for_bit_the_rendered_one(
    tmp_path: Path, learned: Callable[[], Any], renders: list[int]
) -> None:
    learner = learned()
    expected = plain(learner)
    assert np.ptp(expected.colour) > 0.0
    method = CachedMethod(learner, ViewStore(10**6, tmp_path), CHUNK)
    assert method.lookup(camera()) is None
    assert same(method.render(camera()), expected)
    for level in (1, 0, 0):
        hit = method.lookup(camera())
        assert hit is not None
        assert same(hit[0], expected)
        assert hit[1] == level
    fresh = CachedMethod(learner, ViewStore(10**6, tmp_path), CHUNK)
    hit = fresh.lookup(camera())
    assert hit is not None
    assert same(hit[0], expected)
    assert hit[1] == 2
    assert same(fresh.render(camera()), expected)
    assert len(renders) == 1


def test_a_method_that_is_trained_has_other_keys() -> None:
    method = CachedMethod(trained(), ViewStore(10**6), CHUNK)
    before = method.render(camera())
    CHANGES["one more training step"](method.learner)  # type: ignore[arg-type]
    assert method.lookup(camera()) is None
    assert not same(method.render(camera()), before)


def test_weights_are_hashed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[object] = []
    monkeypatch.setattr(cached, "method_digest", lambda learner: calls.append(learner) or b"")
    method = CachedMethod(trained(), ViewStore(10**6), CHUNK)
    for azimuth in range(5):
        method.render(camera(camera_to_world=pose(azimuth, 0.4)))
        method.render(camera(camera_to_world=pose(azimuth, 0.4)))
    assert len(calls) == 1


def test_a_method_that_is_trained_while_it_renders_is_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    method = CachedMethod(trained(), ViewStore(10**6), CHUNK)
    before = method.key(camera())

    def trained_meanwhile(*arguments: object) -> View:
        view = render_view(*arguments)  # type: ignore[arg-type]
        CHANGES["one more training step"](method.learner)  # type: ignore[arg-type]
        return view

    monkeypatch.setattr(cached, "render_view", trained_meanwhile)
    method.render(camera())
    assert method.store.get(before) is None
    assert method.lookup(camera()) is None


def test_something_else_under_the_key_is_a_miss() -> None:
    method = CachedMethod(trained(), ViewStore(10**6), CHUNK)
    method.store.store(method.key(camera()), np.zeros((10, 12, 4), dtype=np.float32))
    assert method.lookup(camera()) is None
    assert same(method.render(camera()), plain(method.learner))  # type: ignore[arg-type]


def test_a_method_that_diverged_raises_and_leaves_nothing() -> None:
    method = CachedMethod(trained(), ViewStore(10**6), CHUNK)
    with torch.no_grad():
        method.learner.coarse.density_head.weight.fill_(torch.nan)  # type: ignore[attr-defined]
    with pytest.raises(Diverged):
        method.render(camera())
    assert method.lookup(camera()) is None


FACTS: dict[str, Callable[[Any], None]] = {
    "bins": lambda learner: setattr(learner, "own", replace(learner.own, bins=25)),
    "box": lambda learner: setattr(learner, "box", Box(learner.box.lower, learner.box.upper + 1e-6)),
    "a training step": lambda learner: learner.train_on(*rays_and_colours(seed=9)),
}


@pytest.mark.parametrize("fact", FACTS)
def test_whatever_a_picture_of_voxels_depends_on_is_in_the_key(fact: str, monkeypatch: pytest.MonkeyPatch) -> None:
    learner = voxels()
    before = key(learner)
    with monkeypatch.context() as patch:
        patch.setattr(keys, "_drjit", lambda: ["0.0", [1, 2, 3]])
        assert key(learner) != before
    assert key(learner) == before
    FACTS[fact](learner)
    assert key(learner) != before
