"""Requirements on every scene of the catalogue; renders of stress scenes and ladders agree with their closed forms."""

from functools import cache

import numpy as np
import pytest

from scenes.catalog.entries import CATALOG, CLASSICS, RUNGS, STRESS, scene_named
from scenes.catalog.ladders.ladders import LADDERS, Ladder
from scenes.catalog.stress import scales
from scenes.files.digest import digest_of
from scenes.files.errors import InputError
from scenes.modelling.needs import PARTS, entries, left_out, needs
from scenes.modelling.normalise import box_of, normalised
from scenes.modelling.scene import Description, Scene
from scenes.modelling.truth import pixel_means, pixel_rays
from scenes.rendering.render import LoadedScene, RenderedView, render_views, seed_from, use
from scenes.rendering.variant import Variant, llvm_libraries, probe
from scenes.view_sets.viewpoints import camera_to_world
from tests.scenes.loading import SCALAR, load


@pytest.fixture(scope="module")
def fast() -> Variant:
    for library in llvm_libraries():
        if probe("llvm_ad_rgb", str(library)) is None:
            return Variant("llvm_ad_rgb", str(library), "test")
    pytest.skip("no libLLVM of version 16 or newer that works")


@cache
def built(name: str) -> tuple[Scene, Description]:
    scene = scene_named(name)
    return scene, scene.build()


@pytest.fixture(params=CLASSICS)
def name(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_the_eight_of_table_2_are_listed_if_an_unknown_scene_is_named() -> None:
    assert list(CLASSICS) == ["chair", "drums", "ficus", "hotdog", "lego", "materials", "mic", "ship"]
    with pytest.raises(InputError, match=r"'teapot'.*chair.*ship"):
        scene_named("teapot")


@pytest.mark.parametrize("name", CATALOG)
def test_it_is_named_and_deterministic(name: str) -> None:
    scene = scene_named(name)
    assert scene.name == name
    assert 10 < len(scene.title) < 120
    assert digest_of(scene.build()) == digest_of(scene.build())  # only plain data can be hashed


def test_its_light_is_infinitely_far_away_and_it_has_no_camera_and_no_integrator(name: str) -> None:
    scene, description = built(name)
    assert 2 <= scene.max_depth <= 64
    assert scene.view_from == ("sphere" if name == "ficus" else "hemisphere")
    assert "integrator" not in description
    types = {entry.get("type") for entry in entries(description)}
    assert types & {"constant", "envmap", "directional"}
    assert not types & {"perspective", "hdrfilm", "area", "point", "spot", "projector", "directionalarea"}


def test_its_meshes_are_valid(name: str) -> None:
    _, description = built(name)
    for entry in entries(description):
        for value in entry.values():
            if isinstance(value, np.ndarray):
                assert np.isfinite(value).all()
        if entry.get("type") == "mesh":
            vertices, faces = entry["vertices"], entry["faces"]
            assert vertices.shape == (len(vertices), 3)
            assert faces.shape == (len(faces), 3)
            assert 0 <= faces.max() < len(vertices)
            assert np.linalg.norm(vertices, axis=1).max() <= 1.4
            assert "bsdf" in entry
            for key, width in (("uv", 2), ("normals", 3)):
                if key in entry:
                    assert entry[key].shape == (len(vertices), width)


def test_its_needs_are_known(name: str) -> None:
    _, description = built(name)
    result = needs(description, np.array([[-1.0] * 3, [1.0] * 3]), pixel=0.03)
    of_training = {"every_bin", "outside_hull", "behind_matter", "background_rays"}
    assert list(result) == [part for part in PARTS if part not in of_training]
    assert {row["name"] for row in left_out(result)} == {
        "background_model", "outside_box", "empty_space", "behind_opaque", "participating_media", "scale_checks",
        "hdr_metrics",
    }  # fmt: skip


@cache
def views_of(name: str, variant: Variant) -> tuple[np.ndarray, list[RenderedView]]:
    scene, description = built(name)
    loaded = LoadedScene(scene, description, variant, 32, 32)
    poses = camera_to_world("test", scene.view_from, 3)
    return loaded.bounds(), list(render_views(loaded, poses, 8, range(3), ["a", "b", "c"]))


def test_it_renders(name: str) -> None:
    scene, _ = built(name)
    bounds, views = views_of(name, SCALAR)
    assert np.abs(bounds).max() < 1.5
    for view in views:
        alpha, colour = view.rgba[..., 3], view.rgba[..., :3]
        assert 0.03 < alpha.mean() < 0.9
        assert alpha.max() == 1.0
        assert not np.concatenate([alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]]).any()  # the object is seen whole
        assert (colour >= 0).all()
        assert 0.02 < colour.sum() / (3 * alpha.sum()) < 1.0
        depth = view.depth[view.depth > 0]
        assert scene.near < depth.min()
        assert depth.max() < scene.far
        assert view.noise_mse < 0.01


@pytest.mark.slow
def test_it_renders_alike_with_llvm(name: str, fast: Variant) -> None:
    slow_views, fast_views = views_of(name, SCALAR)[1], views_of(name, fast)[1]
    for slow, quick in zip(slow_views, fast_views, strict=True):
        for channel in range(4):
            shift = float((slow.rgba - quick.rgba)[..., channel].mean())
            noise = float(np.sqrt((slow.variance + quick.variance)[..., channel].sum())) / slow.depth.size
            assert abs(shift) < 5 * noise
        both = (slow.depth > 0) & (quick.depth > 0)
        assert both.sum() > 0.8 * (slow.depth > 0).sum()
        assert abs((slow.depth - quick.depth)[both].mean()) < 0.02


def test_llvm_gives_the_same_bits_on_any_number_of_threads_and_what_mitsuba_adds_up(fast: Variant) -> None:
    import drjit as dr

    mi, size, spp = use(fast), 32, 324
    scene = LoadedScene.of(scene_named("lego"), fast, size)
    pose = camera_to_world("test", "hemisphere", 1)[0]
    usual, tries = dr.thread_count(), []
    try:
        for threads in (1, 4, 4):
            dr.set_thread_count(threads)
            tries.append([scene.colour(pose, spp, 1), *scene.geometry(pose, spp, 1)])
    finally:
        dr.set_thread_count(usual)
    for again in tries[1:]:
        assert all(map(np.array_equal, tries[0], again))
    camera, integrator = scene._sensor(spp), scene._colour
    theirs = np.array(mi.render(scene._scene, sensor=camera, integrator=integrator, seed=seed_from(1, 0), spp=spp))
    assert np.abs(tries[0][0] - theirs).max() < 1e-5


SIZE = 12
UNIT = Scene("unit", "Ball, block and floor at unit scale: what tiny and huge are held to", scales.unit)
REPEATS = 6
"""The number of independent closed-form and rendered means, from which standard errors are computed."""
WITH_TRUTH = [name for name in (*STRESS, *RUNGS) if scene_named(name).truth is not None]


@cache
def seen(name: str, spp: int = 16) -> tuple[LoadedScene, RenderedView, np.ndarray]:
    scene = scene_named(name)
    loaded = LoadedScene.of(scene, SCALAR, SIZE)
    pose = camera_to_world("test", scene.view_from, 5)[1]
    return loaded, next(render_views(loaded, pose[None], spp, [1], [name])), pose


@pytest.mark.parametrize("ladder", LADDERS.values(), ids=list(LADDERS))
def test_every_ladder_has_five_rungs_that_differ_and_become_harder(ladder: Ladder) -> None:
    assert len({digest_of(scene_named(name).build()) for name in ladder.scenes}) == 5
    if ladder.name != "scale":
        steps = np.diff(ladder.values)
        assert (steps > 0).all() or (steps < 0).all()


@pytest.mark.parametrize("name", [*STRESS, *RUNGS])
def test_a_stress_scene_or_a_rung_renders_inside_its_box(name: str) -> None:
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


@pytest.mark.slow
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
    nothing, view, _ = seen("empty")
    assert not view.rgba.any()
    assert nothing.bounds() == pytest.approx(np.array([[-1.021] * 3, [1.021] * 3])), "the box that it declares"
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
    assert (change is None) == (name == "scale_1")
    assert box_of(description) == pytest.approx(box_of(scales.unit()), abs=1e-5)
    expected = LoadedScene.of(UNIT, SCALAR, SIZE)
    loaded, _, pose = seen(name)
    own = np.array([loaded.colour(pose, 64, seed).mean((0, 1)) for seed in range(REPEATS)])
    theirs = np.array([expected.colour(pose, 64, 100 + seed).mean((0, 1)) for seed in range(REPEATS)])
    error = np.sqrt((own.var(0, ddof=1) + theirs.var(0, ddof=1)) / REPEATS)
    assert (np.abs(own.mean(0) - theirs.mean(0)) < 4.5 * error + 1e-6).all()


def test_emitters_that_are_seen_and_a_sky_exclude_each_other() -> None:
    description = {**scene_named("mirror").build(), "sky": {"type": "constant"}}
    with pytest.raises(RuntimeError, match="sky"):
        load(description, 4, emitters_seen=True)
