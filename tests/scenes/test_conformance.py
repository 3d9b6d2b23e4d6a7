"""Requirements on every scene of the catalogue."""

from functools import cache

import numpy as np
import pytest

from scenes.catalog.entries import CATALOG, CLASSICS, scene_named
from scenes.files.digest import digest_of
from scenes.files.errors import InputError
from scenes.modelling.needs import OF_TRAINING, PARTS, entries, left_out, needs
from scenes.modelling.scene import Description, Scene
from scenes.rendering.render import LoadedScene, RenderedView, render_views, seed_from, use
from scenes.rendering.variant import Variant, llvm_libraries, probe
from scenes.view_sets.viewpoints import camera_to_world


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
    assert list(result) == [part for part in PARTS if part not in OF_TRAINING]
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


def test_it_renders(name: str, scalar: Variant) -> None:
    scene, _ = built(name)
    bounds, views = views_of(name, scalar)
    assert np.abs(bounds).max() < 1.5
    for view in views:
        alpha, colour = view.rgba[..., 3], view.rgba[..., :3]
        assert 0.03 < alpha.mean() < 0.9
        assert alpha.max() == 1.0
        border = np.concatenate([alpha[0], alpha[-1], alpha[:, 0], alpha[:, -1]])
        assert border.max() == 0.0  # the complete object is in the picture
        assert (colour >= 0).all()
        assert 0.02 < colour.sum() / (3 * alpha.sum()) < 1.0
        depth = view.depth[view.depth > 0]
        assert scene.near < depth.min()
        assert depth.max() < scene.far
        assert view.noise_mse < 0.01


def test_it_renders_alike_with_llvm(name: str, scalar: Variant, fast: Variant) -> None:
    slow_views, fast_views = views_of(name, scalar)[1], views_of(name, fast)[1]
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
