"""Stiff and extreme scenes and the ladders: their renders agree with their closed forms."""

from functools import cache

import numpy as np
import pytest

from scenes.catalog.entries import RUNGS, STRESS, scene_named
from scenes.catalog.ladders.ladders import LADDERS, Ladder
from scenes.catalog.ladders.rungs import BUILDERS
from scenes.catalog.stress import scales
from scenes.files.digest import digest_of
from scenes.modelling.needs import left_out
from scenes.modelling.normalise import FRAMED, box_of, normalised
from scenes.modelling.scene import Scene
from scenes.modelling.truth import pixel_means, pixel_rays
from scenes.rendering.render import LoadedScene, RenderedView, render_views
from scenes.rendering.variant import Variant
from scenes.view_sets.viewpoints import camera_to_world

SIZE = 12
UNIT = Scene("unit", "Ball, block and floor at unit scale: what tiny and huge are held to", scales.unit)
REPEATS = 6
"""The number of independent closed-form and rendered means, from which standard errors are computed."""
WITH_TRUTH = [name for name in (*STRESS, *RUNGS) if scene_named(name).truth is not None]


@cache
def seen(name: str, spp: int = 16) -> tuple[LoadedScene, RenderedView, np.ndarray]:
    scene = scene_named(name)
    loaded = LoadedScene.of(scene, Variant("scalar_rgb", None, "test"), SIZE)
    pose = camera_to_world("test", scene.view_from, 5)[1]
    return loaded, next(render_views(loaded, pose[None], spp, [1], [name])), pose


@pytest.mark.parametrize("ladder", LADDERS.values(), ids=list(LADDERS))
def test_every_ladder_has_five_rungs_from_one_function(ladder: Ladder) -> None:
    assert ladder.name in BUILDERS
    assert ladder.scenes == tuple(f"{ladder.name}_{i}" for i in range(1, 6))
    assert len(set(ladder.values)) == 5
    descriptions = {digest_of(scene_named(name).build()) for name in ladder.scenes}
    assert len(descriptions) == 5
    if ladder.name != "scale":
        steps = np.diff(ladder.values)
        assert (steps > 0).all() or (steps < 0).all()


@pytest.mark.parametrize("name", [*STRESS, *RUNGS])
def test_it_renders(name: str) -> None:
    scene = scene_named(name)
    loaded, view, pose = seen(name)
    bounds = loaded.bounds()
    assert np.isfinite(bounds).all()
    assert (bounds[1] > bounds[0]).all()
    assert all(row["reason"] for row in left_out(loaded.needs))
    depth = view.depth[view.depth > 0]
    assert ((depth > scene.near) & (depth < scene.far)).all()
    # everything that is seen lies in the box
    _, d = pixel_rays(pose, SIZE, SIZE)
    hit = view.rgba[..., 3] > 0.999
    points = pose[:3, 3] + d * view.depth[..., None]
    assert ((points[hit] >= bounds[0]) & (points[hit] <= bounds[1])).all()
    assert (view.rgba >= 0).all()
    assert view.noise_mse < 0.02


@pytest.mark.parametrize("name", WITH_TRUTH)
def test_it_is_seen_as_its_closed_form_says(name: str) -> None:
    """Mean colour and opacity of a view: |z| < 4.5 with the standard errors of both sides; depth pixel by pixel."""
    loaded, view, pose = seen(name)
    truth = scene_named(name).truth
    assert truth is not None
    exact = [pixel_means(truth, pose, SIZE, SIZE, 16, np.random.default_rng(k)) for k in range(REPEATS)]
    closed = np.array([rgba.mean((0, 1)) for rgba, _ in exact])
    # whether a path meets fog is random; solid shapes have noise only at their borders
    spp = 512 if loaded.integrator_name == "volpath" else 64
    rendered = np.array([loaded.colour(pose, spp, seed).mean((0, 1)) for seed in range(REPEATS)])
    error = np.sqrt((closed.var(0, ddof=1) + rendered.var(0, ddof=1)) / REPEATS)
    shift = np.abs(rendered.mean(0) - closed.mean(0))
    # 2e-5: what single precision and a path's last bounce may cost, and spreads of zero
    assert (shift <= 4.5 * error + 2e-5 * np.maximum(closed.mean(0), 1e-3)).all(), (rendered.mean(0), closed.mean(0))
    depths = np.array([depth for _, depth in exact])
    calm = (view.rgba[..., 3] > 0.999) & (depths.min(0) > 0) & (np.ptp(depths, axis=0) < 2e-3)
    assert np.abs(view.depth - depths.mean(0))[calm].max(initial=0.0) < 0.05


def test_what_must_be_covered_is_and_what_must_be_empty_is() -> None:
    assert not seen("empty")[1].rgba.any()
    for name in ("wall", "inside", "furnace"):
        assert (seen(name)[1].rgba[..., 3] == 1).all()
    assert not seen("black")[1].rgba[..., :3].any()
    white = seen("white")[1].rgba
    assert np.abs(white[..., :3] - white[..., 3:]).max() < 1e-6
    assert 0.2 < white[..., 3].mean() < 0.4
    assert seen("hdr_emitter")[1].rgba.max() > 1e5


def test_glass_of_index_one_vanishes_over_white() -> None:
    """Where the core is not, red, green, blue and alpha are all one."""
    rgba = seen("glass_air")[1].rgba
    core = np.abs(rgba[..., :3] - rgba[..., 3:]).max(-1) > 1e-5
    assert 0.01 < core.mean() < 0.12
    bent = seen("glass")[1].rgba
    assert (np.abs(bent[..., :3] - bent[..., 3:]).max(-1) > 1e-2).mean() > 1.5 * core.mean()


@pytest.mark.parametrize("name", ["tiny", "huge", *LADDERS["scale"].scenes])
def test_any_unit_is_brought_to_the_unit_scene(name: str) -> None:
    description, change = normalised(scene_named(name))
    unit, none = normalised(UNIT)
    assert none is None
    assert (change is None) == (name == "scale_1")
    assert list(description) == list(unit)
    box, other = box_of(description), box_of(unit)
    assert box is not None
    assert other is not None
    assert np.abs(box - other).max() < 1e-5
    assert FRAMED[0] <= np.abs(box).max() <= FRAMED[1]
    expected = LoadedScene.of(UNIT, Variant("scalar_rgb", None, "test"), SIZE)
    loaded, _, pose = seen(name)
    own = np.array([loaded.colour(pose, 64, seed).mean((0, 1)) for seed in range(REPEATS)])
    theirs = np.array([expected.colour(pose, 64, 100 + seed).mean((0, 1)) for seed in range(REPEATS)])
    error = np.sqrt((own.var(0, ddof=1) + theirs.var(0, ddof=1)) / REPEATS)
    assert (np.abs(own.mean(0) - theirs.mean(0)) < 4.5 * error + 1e-6).all()


def test_emitters_that_are_seen_and_a_sky_exclude_each_other(scalar: Variant) -> None:
    glowing = scene_named("mirror")
    scene = Scene("both", "A sky and a lamp that is seen", lambda: {**glowing.build(), "sky": {"type": "constant"}},
                  emitters_seen=True)  # fmt: skip
    with pytest.raises(RuntimeError, match="sky"):
        LoadedScene.of(scene, scalar, 4)
