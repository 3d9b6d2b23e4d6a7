"""Mitsuba's rays are those of the harness, its radiance is the known one, and the stated noise is the true noise."""

import math

import numpy as np
import pytest

from scenes.catalog.stress.patterns import rgb, sky
from scenes.files.errors import InputError
from scenes.modelling.scene import Description, Scene
from scenes.modelling.solids import Solid, ball, box, mesh
from scenes.modelling.surfaces import matte
from scenes.modelling.truth import pixel_rays
from scenes.rendering.render import LoadedScene, RenderedView, RenderError, even_spp, render_views, seed_from
from scenes.view_sets.pixels import display_from_linear, over_white
from scenes.view_sets.viewpoints import FOV_X_RADIANS, RADIUS, all_poses, poses_on_sphere
from tests.scenes.loading import SCALAR, load, tiny_description

POSE = poses_on_sphere(np.array([0.7]), np.array([0.5]))


def grey(albedo: float) -> Description:
    return matte(rgb(albedo))


def sphere(radius: float, bsdf: Description, center: tuple[float, float, float] = (0, 0, 0)) -> Description:
    return {"type": "sphere", "radius": radius, "center": list(center), "bsdf": bsdf}


def seen(
    shapes: Description, pose: np.ndarray | None = None, size: int = 24, spp: int = 64, max_depth: int = 6,
    width: int | None = None,
) -> RenderedView:  # fmt: skip
    """Return one view of some shapes under a white sky."""
    scene = load({"sky": sky(), **shapes}, size, width, max_depth)
    return next(render_views(scene, POSE if pose is None else pose[None], spp, [0], ["view"]))


def projected(point: np.ndarray, camera_to_world: np.ndarray, width: int, height: int) -> np.ndarray:
    """Column and row by our pinhole: OpenGL axes, pixel centres at +0.5, square pixels, centred optical axis."""
    focal = 0.5 * width / math.tan(0.5 * FOV_X_RADIANS)
    x, y, z = (np.linalg.inv(camera_to_world) @ [*point, 1.0])[:3]
    return np.array([width / 2 + focal * x / -z, height / 2 - focal * y / -z])


@pytest.mark.parametrize("pose", [*all_poses("test")[[0, 31, 77, 150]], *all_poses("train", "sphere")[:3]])
@pytest.mark.parametrize(("width", "height"), [(48, 48), (47, 30)])
def test_mitsubas_rays_are_ours(pose: np.ndarray, width: int, height: int) -> None:
    point = np.array([0.35, -0.28, 0.22])
    view = seen({"dot": sphere(0.06, grey(0.5), tuple(point))}, pose, size=height, width=width, spp=128)
    alpha = view.rgba[..., 3].astype(np.float64)
    rows, columns = np.mgrid[:height, :width] + 0.5
    centroid = np.array([(columns * alpha).sum(), (rows * alpha).sum()]) / alpha.sum()
    assert np.abs(centroid - projected(point, pose, width, height)).max() < 0.05  # half a pixel off would be 0.5


def test_depth_is_the_distance_along_the_unit_ray() -> None:
    pose, size, pieces = poses_on_sphere(np.array([0.2]), np.array([0.6]))[0], 40, 10
    view = seen({"ball": sphere(1.0, grey(0.5))}, pose, size=size, spp=256)
    _, direction = pixel_rays(pose, size, size, pieces)
    along = -(direction @ pose[:3, 3])
    with np.errstate(invalid="ignore"):
        exact = along - np.sqrt(along**2 - pose[:3, 3] @ pose[:3, 3] + 1.0)
    expected = exact.reshape(size, pieces, size, pieces).mean((1, 3))
    hit = np.isfinite(expected)
    assert hit.sum() > 300
    steep = (np.abs(np.gradient(np.where(hit, expected, np.nan))) > 0.03).any(axis=0)
    calm = hit & ~steep & np.isfinite(np.gradient(np.where(hit, expected, np.nan))).all(axis=0)
    assert np.abs(view.depth - expected)[calm].max() < 1e-3
    assert abs((view.depth - expected)[calm].mean()) < 1e-4  # Mitsuba's near plane would add 1e-3
    assert (view.depth[view.rgba[..., 3] == 0] == 0).all()
    point = pose[:3, 3] + direction[5::10, 5::10] * view.depth[..., None]
    normal = point / np.linalg.norm(point, axis=-1, keepdims=True)
    assert np.abs(view.normal - normal)[calm].max() < 0.06
    assert (np.linalg.norm(view.normal, axis=-1)[view.rgba[..., 3] == 0] == 0).all()


@pytest.mark.parametrize("albedo", [0.0, 0.18, 0.5, 1.0])
def test_a_convex_body_under_a_uniform_sky_has_its_albedo_as_radiance(albedo: float) -> None:
    view = seen({"ball": sphere(0.9, grey(albedo))}, spp=128)
    complete = view.rgba[..., 3] == 1
    assert complete.sum() > 50
    assert view.rgba[complete][:, :3].mean() == pytest.approx(albedo, abs=0.004)
    assert (view.rgba[view.rgba[..., 3] == 0] == 0).all()


def test_a_mesh_is_the_shape_that_it_describes() -> None:
    """Vertices, faces, normals and uv reach Mitsuba: a fine mesh of a ball looks like the ball."""
    bsdf = matte((0.7, 0.2, 0.1))
    exact = seen({"ball": sphere(0.8, bsdf)}, spp=64)
    meshed = seen({"ball": mesh(ball(0.8, 96), bsdf)}, spp=64)
    assert np.abs(exact.rgba - meshed.rgba).mean() < 0.01
    assert np.abs(exact.depth - meshed.depth)[exact.rgba[..., 3] == 1].max() < 0.02
    assert np.abs(exact.normal - meshed.normal)[exact.rgba[..., 3] == 1].max() < 0.2


def test_textures_are_linear_colour_at_the_right_place() -> None:
    picture = np.zeros((2, 2, 3), np.float32)
    picture[0], picture[1] = [0.2, 0.0, 0.0], [0.0, 0.4, 0.0]
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    square = Solid(np.c_[2 * uv - 1, np.zeros(4)], np.array([[0, 1, 2], [0, 2, 3]]), uv)
    floor = mesh(square, matte({"type": "bitmap", "data": picture, "filter_type": "nearest"}))
    above = poses_on_sphere(np.array([-np.pi / 2]), np.array([np.pi / 2 - 1e-3]))[0]  # x to the right, y up
    view = seen({"floor": floor}, above, spp=64)
    middle = view.rgba[:, 12, :3]
    rows = np.flatnonzero(middle.sum(-1) > 0.1)
    upper, lower = middle[rows[1]], middle[rows[-2]]
    assert upper == pytest.approx([0.0, 0.4, 0.0], abs=0.02)  # the first row of a picture lies at v = 0
    assert lower == pytest.approx([0.2, 0.0, 0.0], abs=0.02)


@pytest.mark.parametrize(
    "bsdf", [{"type": "dielectric"}, {"type": "roughdielectric", "alpha": 0.1}, {"type": "conductor"}]
)
def test_glass_is_an_object_and_not_a_hole(bsdf: Description) -> None:
    view = seen({"glass": sphere(0.9, bsdf)}, spp=32, max_depth=12)
    assert view.rgba[12, 12, 3] == 1
    assert view.rgba[0, 0, 3] == 0
    assert view.rgba[10:14, 10:14, :3].mean() > 0.3


def test_half_covered_pixels_have_half_the_alpha() -> None:
    pose = poses_on_sphere(np.array([0.0]), np.array([0.0]))[0]  # looks along −x; y to the right
    view = seen({"block": mesh(box(0.01, 4, 4).moved(y=2), grey(0.5))}, pose, size=9, spp=256)
    assert view.rgba[4, :, 3] == pytest.approx([0, 0, 0, 0, 0.5, 1, 1, 1, 1], abs=0.02)


def test_the_stated_variance_is_the_variance() -> None:
    scene = load(tiny_description(), 16)
    pose = all_poses("test")[:1]
    truth = next(render_views(scene, pose, 4096, [99], ["truth"]))
    views = list(render_views(scene, np.repeat(pose, 40, 0), 8, range(40), [str(n) for n in range(40)]))
    stated = np.mean([view.variance for view in views], axis=0)
    result = np.mean([(view.rgba - truth.rgba) ** 2 for view in views], axis=0)
    for channel in range(4):
        assert result[..., channel].sum() / stated[..., channel].sum() == pytest.approx(1.0, abs=0.1)
    noisy = stated[..., 0] > stated[..., 0].max() / 10
    assert np.quantile(result[noisy][:, 0] / stated[noisy][:, 0], [0.05, 0.95]) == pytest.approx([0.7, 1.4], abs=0.35)
    shown = over_white(display_from_linear(truth.rgba))
    error = np.mean([np.mean((over_white(display_from_linear(view.rgba)) - shown) ** 2) for view in views])
    assert error / np.mean([view.noise_mse for view in views]) == pytest.approx(1.0, abs=0.15)
    mean = np.mean([view.rgba for view in views], axis=0)
    z = (mean - truth.rgba)[noisy][:, :3] / np.sqrt(stated[noisy][:, :3] / 40)
    assert abs(z.mean()) < 4 / np.sqrt(z.size)  # no bias
    assert z.std() == pytest.approx(1.0, abs=0.2)


def test_without_media_both_integrators_give_the_same_light() -> None:
    """What needs no volumetric integrator is rendered by `path`, without bias. The mean product of two independent
    differences is the square of the true one, without noise.
    """
    description = {
        "sky": sky(),
        "a": sphere(0.8, {"type": "conductor"}),
        "b": sphere(0.5, grey(0.6), (0.9, 0, 0.9)),
    }
    scene = Scene("test", "A test scene", lambda: description)

    def squared(scale: float) -> float:
        halves = {}
        for name in ("path", "volpath"):
            loaded = LoadedScene(scene, description, SCALAR, 16, 16, name)
            images = [loaded.colour(all_poses("test")[3], 64, seed_from(name, half)) for half in "ab"]
            shown = [over_white(display_from_linear(scale * image if name == "path" else image)) for image in images]
            halves[name] = [image.astype(np.float64).reshape(4, 4, 4, 4, 3).mean(axis=(1, 3)) for image in shown]
        (a, b), (c, d) = halves["path"], halves["volpath"]
        return float(np.mean((a - c) * (b - d)))

    assert squared(1.0) < 2e-3**2 < squared(0.97), "a bias of 3 % would be seen"


def test_every_view_has_a_seed_of_its_own() -> None:
    assert len({seed_from(scene, split, n) for scene in "ab" for split in "cd" for n in range(1000)}) == 4000


def test_passes_add_up_to_the_same_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = load(tiny_description(), 12)
    pose = all_poses("test")[3]
    complete = scene.colour(pose, 1024, 1)
    monkeypatch.setattr("scenes.rendering.render.LARGEST_WAVEFRONT", 12 * 12 * 64)
    scene._vectorised = True
    assert scene._passes(1024) == (16, 64)
    assert scene.actual_spp(2048) == 2048
    assert np.abs(scene.colour(pose, 1024, 2) - complete).mean() < 0.01


def test_sample_counts_fit_the_strata() -> None:
    for spp in range(1, 300):
        chosen = even_spp(spp)
        columns = math.isqrt(spp)
        assert spp <= chosen < spp + columns
        assert chosen % columns == 0


@pytest.mark.parametrize(
    "matrix", [np.full((4, 4), np.nan), np.zeros((4, 4)), np.diag([1.0, 1, 0, 1]), np.diag([3.0, 3, 3, 1])]
)
def test_poses_that_mitsuba_would_show_as_background_are_refused(matrix: np.ndarray) -> None:
    scene = load(tiny_description(), 8)
    poses = np.stack([all_poses("test")[0], matrix])
    with pytest.raises(InputError, match="second"):
        next(render_views(scene, poses, 4, [0, 1], ["first", "second"]))
    with pytest.raises(InputError, match="1 samples"):
        next(render_views(scene, poses[:1], 1, [0], ["first"]))


@pytest.mark.parametrize("radiance", [float("nan"), float("inf")])
def test_an_image_that_is_not_finite_is_never_stored(radiance: float) -> None:
    light = {"type": "constant", "radiance": rgb(radiance, 1.0, 1.0)}
    try:
        scene = load({"sky": light, "ball": sphere(0.9, grey(0.5))}, 8)
    except RuntimeError:
        return  # Mitsuba itself refuses
    with pytest.raises(RenderError, match=r"view: .* not finite"):
        next(render_views(scene, all_poses("test")[:1], 4, [0], ["view"]))


def test_a_scene_without_shapes_has_no_box() -> None:
    with pytest.raises(RenderError, match="no shape"):
        load({"sky": sky()}, 8).bounds()


@pytest.mark.parametrize(
    "entry",
    [
        {"type": "checkerboard", "data": np.zeros((2, 2, 3), np.float32)},
        {"type": "mesh", "vertices": np.zeros((3, 3)), "faces": np.zeros((1, 3)), "colour": 1},
    ],
)
def test_what_a_description_cannot_say_is_refused(entry: Description) -> None:
    with pytest.raises(RenderError, match=r"checkerboard|colour"):
        load({"sky": sky(), "thing": entry}, 8)


def test_what_glows_is_seen_only_where_the_scene_says_so() -> None:
    glow = {"type": "area", "radiance": rgb(0.3, 0.2, 0.1)}
    lamp = {"lamp": {**sphere(0.8, grey(0.0)), "emitter": glow}}
    for shown in (False, True):
        scene = load(lamp, 9, max_depth=3, emitters_seen=shown)
        view = next(render_views(scene, POSE, 4, [0], ["view"]))
        expected = [0.3, 0.2, 0.1, 1.0] if shown else [0.0] * 4
        assert view.rgba[4, 4] == pytest.approx(expected, abs=1e-6)
        assert view.rgba[0, 0] == pytest.approx([0.0] * 4)


def test_a_lamp_that_is_hidden_is_in_no_depth_and_no_normal() -> None:
    """A lamp between the camera and a ball: depth and normals are those of the ball."""
    thing = {"ball": sphere(0.4, grey(0.6)), "sky": sky()}
    glow = {"type": "area", "radiance": rgb(3.0)}
    lamp = {**sphere(0.3, grey(0.0), tuple((0.3 * POSE[0, :3, 3]).tolist())), "emitter": glow}
    lit, plain = (
        next(render_views(load(shapes, 15, max_depth=3), POSE, 8, [0], ["view"]))
        for shapes in ({**thing, "lamp": lamp}, thing)
    )
    assert np.array_equal(lit.depth, plain.depth)
    assert np.array_equal(lit.normal, plain.normal)
    assert (lit.depth[7, 7], lit.depth[0, 0]) == (pytest.approx(RADIUS - 0.4, abs=0.02), 0)
    assert (lit.depth[lit.rgba[..., 3] == 0] == 0).all()
    assert lit.rgba[7, 7, 0] > plain.rgba[7, 7, 0] + 0.1  # it does light the ball


def test_instances_beside_a_lamp_are_refused() -> None:
    lamp = {"lamp": {**sphere(0.3, grey(0.0), (0, 0, 2)), "emitter": {"type": "area"}}}
    group = {"group": {"type": "shapegroup", "ball": sphere(0.4, grey(0.5))}}
    placed = {"placed": {"type": "instance", "of": {"type": "ref", "id": "group"}}}
    load({**group, **placed, "sky": sky()}, 4)
    with pytest.raises(InputError, match="instances and a glowing shape"):
        load({**group, **placed, **lamp}, 4)
