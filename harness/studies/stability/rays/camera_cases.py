"""C1: invalid cameras and rays must be refused before anything is rendered."""

import json
import math
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from baselines.contract import Rays
from baselines.numerics.bounds import ray_box
from harness.records.study import Check, check
from harness.studies.framework import Found
from harness.studies.stability.stability_context import StabilityContext, error_of, none_of, ours_and_usual, worst_of
from harness.training.batches import Cameras
from scenes.files.errors import InputError
from scenes.modelling.scene import Scene
from scenes.view_sets.formats.transforms import read_transforms, write_transforms
from scenes.view_sets.images import write_png
from scenes.view_sets.view_set import read_view_set
from scenes.view_sets.viewpoints import FOV_X_RADIANS, all_poses, check_field_of_view, check_poses, look_at

SIZE = 4
"""The width in pixels of the images of a foreign view set."""
FOCAL = 0.5 * SIZE / math.tan(0.5 * FOV_X_RADIANS)
WAYS_TO_LOOK = {
    "origin on target": ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [0.0, 0.0, 1.0]),
    "up along the view": ([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
    "up against the view": ([0.0, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 0.0, -2.0]),
    "up of no length": ([4.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    "NaN origin": ([math.nan, 0.0, 4.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]),
}


def _damaged() -> dict[str, np.ndarray]:
    good = all_poses("train")[0]
    sheared, row, nan, infinite = (good.copy() for _ in range(4))
    sheared[:3, 0] += 0.02 * sheared[:3, 1]
    row[3, 0] = 1e-3
    nan[1, 1] = math.nan
    infinite[0, 3] = math.inf
    return {
        "mirrored": good * [-1, 1, 1, 1], "singular": good * [0, 0, 0, 1],
        "stretched by 1.01": good * [1.01, 1, 1, 1], "sheared": sheared,
        "last row not 0 0 0 1": row, "NaN": nan, "infinite": infinite,
    }  # fmt: skip


def _accepted(what: str, attempts: dict[str, Callable[[], object]], error: type[Exception]) -> Check:
    return none_of(what, [name for name, attempt in attempts.items() if error_of(error, attempt) is None], "harness")


def cameras(context: StabilityContext) -> Iterator[Found]:
    yield _refused(context.scratch)
    yield _rendered_by_mitsuba_without_checks()
    yield from _slabs()
    yield from _directions()
    poses = all_poses("test")[[0, 50, 0, 100]]
    views = read_view_set(_foreign(context.scratch / "twice", poses), splits=("train",), scratch=context.scratch)
    named = ["r_2.png has the camera of train: r_0.png" in line for line in views.repeated_views] == [True]
    why = "; ".join(views.repeated_views)
    yield check("the one view that is there twice is reported", float(named), low=1, why=why, subject="harness")


def _refused(scratch: Path) -> Check:
    """Try every invalid camera by every entry: poses of this harness, a foreign file, look_at, angles, distances."""

    def read(poses: np.ndarray, fov: float = FOV_X_RADIANS) -> object:
        return read_transforms(_foreign(scratch, poses, fov), "train")

    attempts: dict[str, Callable[[], object]] = {}
    for what, pose in _damaged().items():
        attempts[f"pose: {what}"] = partial(check_poses, pose[None], ["view"])
        attempts[f"file: {what}"] = partial(read, pose[None])
    for what, vectors in WAYS_TO_LOOK.items():
        attempts[f"look_at: {what}"] = partial(look_at, *map(np.array, vectors))
    for degrees in (-10.0, 0.0, 180.0, 360.0, math.nan):
        fov = math.radians(degrees)
        attempts[f"field of view {degrees:g}°"] = partial(check_field_of_view, fov, "the camera")
        attempts[f"file: field of view {degrees:g}°"] = partial(read, all_poses("test")[:1], fov)
    for near, far in ((2.0, 2.0), (6.0, 2.0), (0.0, 6.0), (-1.0, 6.0), (2.0, math.inf), (math.nan, 6.0)):
        attempts[f"near {near:g}, far {far:g}"] = partial(Scene, "s", "t", dict, near=near, far=far)
    return _accepted(f"of {len(attempts)} invalid cameras, those that are not refused", attempts, InputError)


def _foreign(scratch: Path, poses: np.ndarray, fov: float = FOV_X_RADIANS) -> Path:
    folder = scratch / "foreign_cameras"
    folder.mkdir(parents=True, exist_ok=True)
    names = [f"./r_{number}" for number in range(len(poses))]
    for name in names:
        file = folder / f"{name}.png"
        if not file.exists():
            write_png(file, np.full((SIZE, SIZE, 4), 0.5, np.float32))
    cameras_file = folder / "transforms_train.json"
    write_transforms(cameras_file, FOV_X_RADIANS if math.isnan(fov) else fov, names, poses)
    if math.isnan(fov):  # strict JSON has no NaN, but other programs write it
        content = {**json.loads(cameras_file.read_text(encoding="utf-8")), "camera_angle_x": math.nan}
        cameras_file.write_text(json.dumps(content), encoding="utf-8")
    return folder


def _rendered_by_mitsuba_without_checks() -> Check:
    from scenes.rendering.render import use
    from scenes.rendering.variant import Variant

    mi = use(Variant("scalar_rgb", None, "eight pixels only"))
    scene = mi.load_dict({"type": "scene", "sky": {"type": "constant"}, "ball": {"type": "sphere", "radius": 1.0}})
    film = {"type": "hdrfilm", "width": 8, "height": 8, "pixel_format": "rgba"}
    silent = []
    tries: dict[str, Callable[[], object]] = {
        what: partial(mi.ScalarTransform4f().look_at, *vectors) for what, vectors in WAYS_TO_LOOK.items()
    }
    tries["NaN"] = partial(mi.ScalarTransform4f, _damaged()["NaN"])
    for what, to_world in tries.items():
        try:
            sensor = mi.load_dict({"type": "perspective", "to_world": to_world(), "film": film})
            integrator = mi.load_dict({"type": "path", "max_depth": 3, "hide_emitters": True})
            image = np.array(mi.render(scene, sensor=sensor, integrator=integrator, spp=4))
        except (RuntimeError, ValueError):
            continue
        if np.isfinite(image).all() and not image.any():
            silent.append(what)
    what = f"of {len(tries)} invalid cameras, those that render a clean background without a message"
    return none_of(what, silent, "Mitsuba without checks", "usual")


def _axis_parallel() -> tuple[Tensor, Tensor]:
    """Return origins and directions [rays, 3] along and against every axis, with ±0: outside, on faces, inside."""
    places = torch.cartesian_prod(*[torch.tensor([-2.0, -1.0, 0.25, 1.0, 2.0])] * 3)
    ways = product(range(3), (1.0, -1.0), (0.0, -0.0))
    d = torch.tensor([[sign if i == axis else zero for i in range(3)] for axis, sign, zero in ways])
    return places.repeat_interleave(len(d), 0), d.repeat(len(places), 1)


def _exact(o: Tensor, d: Tensor, near: float, far: float) -> tuple[float, float] | None:
    """Return the interval of an axis-parallel ray inside [−1, 1]³, by cases; None if it has no length."""
    axis = int(d.abs().argmax())
    if any(abs(float(o[other])) > 1.0 for other in range(3) if other != axis):
        return None
    start, sign = float(o[axis]), float(d[axis])
    enter, leave = sorted(((-1.0 - start) * sign, (1.0 - start) * sign))
    enter, leave = max(enter, near), min(leave, far)
    return (enter, leave) if leave > enter else None


def naive_slab(
    o: Tensor, d: Tensor, lower: Tensor, upper: Tensor, near: float, far: float
) -> tuple[Tensor, Tensor, Tensor]:
    """Intersect as is usual: divide by d, take minima and maxima."""
    first, second = (lower - o) / d, (upper - o) / d
    entry = torch.minimum(first, second).amax(dim=-1).clamp(min=near)
    leave = torch.maximum(first, second).amin(dim=-1).clamp(max=far)
    return entry, leave, leave > entry


def _slabs() -> Iterator[Check]:
    o, d = _axis_parallel()
    box, near, far = torch.ones(3), 0.5, 6.0
    expected = [_exact(*ray, near, far) for ray in zip(o, d, strict=True)]
    wrong = {}
    for subject, slab in (("harness", ray_box), ("slab test", naive_slab)):
        rays = zip(*(column.tolist() for column in slab(o, d, -box, box, near, far)), strict=True)
        intervals = [(entry, leave) if hit else None for entry, leave, hit in rays]
        wrong[subject] = sum(a != b for a, b in zip(intervals, expected, strict=True))
    what = f"axis-parallel rays of {len(o)} with a wrong interval, on the faces of the box and off them"
    yield from ours_and_usual(what, wrong, high=0)


def _directions() -> Iterator[Check]:
    poses = all_poses("train")[:8].copy()
    poses[:, :3, :3] *= 1.0 + 4e-4  # which `check_poses` still accepts
    check_poses(poses, [str(number) for number in range(len(poses))])
    camera = Cameras.of(poses, SIZE, SIZE, FOCAL, 2.0, 6.0)
    off = worst_of(
        float((camera.all_rays(view).directions.norm(dim=-1) - 1).abs().max()) for view in range(len(camera))
    )
    yield check("largest deviation of a direction's length from 1", off, high=5e-7, subject="harness")
    attempts: dict[str, Callable[[], object]] = {}
    for length in (0.0, 0.5, 0.99, 1.01, 2.0, math.nan, math.inf):
        d = torch.nn.functional.normalize(torch.ones(3, 3), dim=-1)
        d[1] *= length
        attempts[f"length {length:g}"] = Rays(torch.zeros(3, 3), d, 2.0, 6.0).require_finite
    yield _accepted("rays accepted although their direction is not a unit vector", attempts, ValueError)
    tolerated = _spread_of_opacity(_middle_ray(scale) for scale in (0.9996, 1.0, 1.0004))
    what = "change of a ray's opacity with the scale of its camera matrix, within the accepted scales"
    yield check(what, tolerated, high=1e-6, subject="harness")
    o, d = torch.tensor([[-4.0, 0.0, 0.0]]), torch.tensor([[1.0, 0.0, 0.0]])
    unchecked = _spread_of_opacity((o, length * d) for length in (0.5, 1.0, 2.0))
    what = "change of a ray's opacity with the length of its direction, 0.5 to 2"
    yield check(what, unchecked, high=1e-6, subject="no check of d", owner="usual")


def _middle_ray(scale: float) -> tuple[Tensor, Tensor]:
    pose = all_poses("test")[:1].copy()
    pose[:, :3, :3] *= scale
    rays = Cameras.of(pose, SIZE, SIZE, FOCAL, 2.0, 6.0).all_rays(0)
    middle = SIZE * SIZE // 2 + SIZE // 2
    return rays.origins[middle : middle + 1], rays.directions[middle : middle + 1]


def _spread_of_opacity(rays: Iterable[tuple[Tensor, Tensor]]) -> float:
    """Return the range of the opacities of rays through the cube ±1 of density 0.5, with distances as scene units."""
    opacities = []
    for o, d in rays:
        entry, leave, _ = ray_box(o, d, -torch.ones(3), torch.ones(3), 0.0, 100.0)
        opacities.append(-math.expm1(-0.5 * float(leave - entry)))
    return max(opacities) - min(opacities)
