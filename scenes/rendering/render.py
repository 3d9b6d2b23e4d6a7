"""Descriptions → Mitsuba → images. All training images are rendered here.

Mitsuba's camera (x left, y up, looking along +z) and the input of its materials are converted only here.
"""

import hashlib
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from scenes.files.errors import InputError
from scenes.modelling.needs import Needs, needs
from scenes.modelling.normalise import check_scale, normalised
from scenes.modelling.placement import Placement
from scenes.modelling.scene import Description, Scene
from scenes.rendering.variant import Variant
from scenes.view_sets.pixels import display_from_linear, over_white
from scenes.view_sets.viewpoints import FOV_X_RADIANS, check_poses

RENDERER_VERSION = 3
"""Increased with every change of the images, so that cached view sets are rendered again."""
OWN_SCENES_VERSION = 2
"""Increased with every change that concerns only the images of users' scenes."""
NEAR_CLIP = 1e-3
NORMAL_SPP = {False: 2, True: 16}
"""The samples per pixel for normals, scalar and vectorised: Mitsuba has no cheap way to them in the scalar variant."""
LARGEST_WAVEFRONT = 1 << 22
"""The maximum number of paths in flight in a vectorised variant; more are rendered in passes."""
_OPENGL_FROM_MITSUBA = np.diag([-1.0, 1.0, -1.0, 1.0])


class RenderError(RuntimeError):
    """A scene of the catalogue cannot be rendered: a defect of the scene, not of the user's input."""


@dataclass(frozen=True)
class RenderedView:
    """One view: the mean of two independent renders of half the samples each."""

    rgba: np.ndarray
    """The image, float32 [h, w, 4], linear, premultiplied."""
    variance: np.ndarray
    """The estimated variance of `rgba`, float32 [h, w, 4]: (a − b)² / 4 of the two halves; unbiased."""
    depth: np.ndarray
    """The distance along the unit ray to the first surface, float32 [h, w], the mean over hits; 0 for none."""
    normal: np.ndarray
    """The outward shading normal in the world, float32 [h, w, 3], the unit mean over hits; 0 for none."""
    noise_mse: float
    """The expected mean square error of the display image over white due to noise."""


class LoadedScene:
    """A description as Mitsuba objects, ready to be seen from many sides."""

    def __init__(
        self, scene: Scene, description: Description, variant: Variant, width: int, height: int,
        integrator: str | None = None,
    ) -> None:  # fmt: skip
        """Load the scene as `description` says, which may be normalised, or by its own `load`.

        `integrator` is `path` or `volpath`, by default what the scene needs. Raises `InputError` for a scene so small
        or so far away that its images would be biased.
        """
        mi = use(variant)
        self.needs: Needs = needs(description)
        self.integrator_name = integrator or ("volpath" if self.needs["participating_media"].needed else "path")
        self.width, self.height = width, height
        self._variant = variant
        self._vectorised = not variant.name.startswith("scalar")
        self.placement: Placement | None = None
        if scene.load is None:
            entries = {name: to_mitsuba(value) for name, value in description.items()}
            self._scene = mi.load_dict({"type": "scene", **entries})
        else:
            self._scene, self.placement, self.box_in_file = scene.load(mi)
        self._solid = self._scene if scene.emitters_seen else _without_lamps(mi, self._scene)
        """The scene that a camera sees, for depth and normals."""
        # three renders: one `aov` integrator would trace every path twice, and per ray the scalar variant of it takes
        # 50 times as long as `depth`
        depth, seen = scene.max_depth, scene.emitters_seen
        colour = {"type": self.integrator_name, "max_depth": depth, "hide_emitters": not seen}
        if self.integrator_name == "volpath":
            # by default it ends one path in twenty at every scattering, even in fog that absorbs nothing
            colour["rr_depth"] = depth
        if seen and self._scene.environment() is not None:
            raise RenderError("emitters are to be seen, and there is a sky: every pixel would be covered by it")
        self._colour = mi.load_dict(colour)
        self._distance = mi.load_dict({"type": "depth"})
        self._normal = mi.load_dict({"type": "aov", "aovs": "normal:sh_normal"})
        self._sensors: dict[int, Any] = {}
        self._declared = scene.box
        check_scale(self.box())

    @staticmethod
    def of(scene: Scene, variant: Variant, size: int, integrator: str | None = None) -> "LoadedScene":
        """Load a scene of the catalogue as it is rendered: normalised where necessary."""
        description, _ = normalised(scene)
        return LoadedScene(scene, description, variant, size, size, integrator)

    def box(self) -> np.ndarray:
        """Return the corners [2, 3], float64, of the box around all shapes, or the declared box."""
        if self.placement is not None:
            return self.placement.box(self.box_in_file)
        box = self._scene.bbox()
        corners = np.array([box.min, box.max], dtype=np.float64).reshape(2, 3)
        if self._declared is not None and not box.valid():
            corners = np.array(self._declared, dtype=np.float64)
        if not np.isfinite(corners).all() or (corners[1] < corners[0]).any():
            raise RenderError(f"the scene's box is {corners.tolist()}: it has no shape, or a shape that is not finite")
        return corners

    def bounds(self) -> np.ndarray:
        """Return `box`, padded by 1 % of its longest side."""
        corners = self.box()
        padding = 0.01 * float((corners[1] - corners[0]).max()) + 1e-3
        return np.asarray(corners + np.array([[-padding], [padding]]))

    def colour(self, camera_to_world: np.ndarray, spp: int, seed: int) -> np.ndarray:
        """Return one independent estimate: float64 [h, w, 4], linear, premultiplied."""
        return self._render(self._scene, self._colour, camera_to_world, spp, seed)

    def geometry(self, camera_to_world: np.ndarray, spp: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Return depth [h, w] and unit normal [h, w, 3] of the first surface, as `RenderedView` has them, float64."""
        distance = self._render(self._solid, self._distance, camera_to_world, spp, seed)
        hits = distance[..., 3]
        mean = distance[..., 0] / np.where(hits > 0, hits, 1.0)
        # Mitsuba's rays start on the near plane, not at the camera
        focal = 0.5 * self.width / math.tan(0.5 * FOV_X_RADIANS)
        x = (np.arange(self.width) + 0.5 - 0.5 * self.width) / focal
        y = (np.arange(self.height) + 0.5 - 0.5 * self.height) / focal
        depth = np.where(hits > 0, mean + NEAR_CLIP * np.sqrt(1 + x**2 + y[:, None] ** 2), 0.0)
        normal = self._render(self._solid, self._normal, camera_to_world, NORMAL_SPP[self._vectorised], seed)
        if self.placement is not None:
            depth *= self.placement.scale
            normal = normal @ self.placement.rotation.T
        length = np.linalg.norm(normal, axis=-1, keepdims=True)
        return depth, np.where(length > 1e-6, normal / np.where(length > 1e-6, length, 1.0), 0.0)

    def _render(self, scene: Any, integrator: Any, camera_to_world: np.ndarray, spp: int, seed: int) -> np.ndarray:
        """Return the mean over all passes, float64 [h, w, channels]."""
        mi = use(self._variant)
        passes, spp_pass = self._passes(spp)
        sensor = self._sensor(spp_pass)
        if self.placement is not None:
            camera_to_world = self.placement.camera(camera_to_world)
        parameters = mi.traverse(sensor)
        parameters["to_world"] = mi.Transform4f(camera_to_world @ _OPENGL_FROM_MITSUBA)
        parameters.update()
        images = (
            _estimate(mi, scene, integrator, sensor, spp_pass, seed_from(seed, number)) for number in range(passes)
        )
        total = next(images).astype(np.float64)
        for image in images:
            total += image
        return total / passes

    def actual_spp(self, spp: int) -> int:
        """Return the samples per pixel that both halves together take for `spp`: `spp` or a few more."""
        passes, spp_pass = self._passes(math.ceil(spp / 2))
        return 2 * passes * spp_pass

    def _passes(self, spp: int) -> tuple[int, int]:
        """Return the passes of one half of `spp` samples, and the samples of each."""
        passes = math.ceil(self.width * self.height * spp / LARGEST_WAVEFRONT) if self._vectorised else 1
        return passes, even_spp(math.ceil(spp / passes))

    def _sensor(self, spp: int) -> Any:
        import mitsuba as mi

        if spp not in self._sensors:
            film = {
                "type": "hdrfilm", "width": self.width, "height": self.height, "rfilter": {"type": "box"},
                "pixel_format": "rgba", "component_format": "float32",
            }  # fmt: skip
            self._sensors[spp] = mi.load_dict(
                {
                    "type": "perspective", "fov": math.degrees(FOV_X_RADIANS), "fov_axis": "x",
                    "near_clip": NEAR_CLIP, "far_clip": 1e5, "film": film,
                    "sampler": {"type": "multijitter", "sample_count": spp},
                }
            )  # fmt: skip
        return self._sensors[spp]


def _estimate(mi: ModuleType, scene: Any, integrator: Any, sensor: Any, spp: int, seed: int) -> np.ndarray:
    """Return the image of one pass: [h, w, channels].

    In a vectorised variant `mi.render` adds samples to the film in the order of its threads, so two renders differ in
    their last bits. Here the samples of a pixel are the same, and are added in a fixed order.
    """
    if mi.variant().startswith("scalar"):
        return np.array(mi.render(scene, sensor=sensor, integrator=integrator, seed=seed, spp=spp))
    import drjit as dr

    width, height = sensor.film().crop_size()
    sampler = sensor.sampler().clone()
    sampler.set_samples_per_wavefront(spp)
    sampler.seed(seed, width * height * spp)
    pixel = dr.arange(mi.UInt32, width * height * spp) // dr.opaque(mi.UInt32, spp)
    corner = mi.Vector2f(pixel % width, pixel // width)
    place = (corner + sampler.next_2d()) / mi.ScalarVector2f(width, height)
    ray, _ = sensor.sample_ray_differential(sensor.shutter_open(), 0.0, place, mi.Point2f(0.5))
    light, seen, others = integrator.sample(scene, sampler, ray)
    channels = others or [*light, dr.select(seen, mi.Float(1), mi.Float(0))]
    dr.eval(channels)  # together: separate evaluations would trace all paths again
    sums = [dr.block_sum(channel, spp, mode="evaluated") for channel in channels]
    return np.stack([np.array(channel).reshape(height, width) for channel in sums], axis=-1) / spp


def _without_lamps(mi: ModuleType, scene: Any) -> Any:
    """Return the scene without shapes that glow, which the colour integrator hides. Raises `InputError` if shapes are
    instances: Mitsuba cannot put their groups into another scene.
    """
    solid = [shape for shape in scene.shapes() if not shape.is_emitter()]
    if len(solid) == len(scene.shapes()):
        return scene
    if any(shape.class_name() == "Instance" for shape in solid):
        raise InputError("instances and a glowing shape: depth would show the lamp; light them by a sky instead")
    return mi.load_dict({"type": "scene", **{f"shape {number}": shape for number, shape in enumerate(solid)}})


def use(variant: Variant) -> ModuleType:
    """Return Mitsuba with that variant set; the LLVM library is named before Dr.Jit loads one."""
    if variant.libllvm:
        os.environ["DRJIT_LIBLLVM_PATH"] = variant.libllvm
    import mitsuba as mi

    if mi.variant() != variant.name:
        mi.set_variant(variant.name)
    mi.set_log_level(mi.LogLevel.Error)
    module: ModuleType = mi
    return module


def render_views(
    scene: LoadedScene, camera_to_world: np.ndarray, spp: int, seeds: Sequence[int], names: Sequence[str]
) -> Iterator[RenderedView]:
    """Render each pose [n, 4, 4] with at least `spp` samples per pixel, one at a time, so that progress can be shown.

    `seeds` and `names` hold one entry per view. Raises `InputError` before the first render for a pose that is not
    rigid or for fewer than 2 samples, and `RenderError` for an image that is not finite.
    """
    if spp < 2:
        raise InputError(f"{spp} samples per pixel: two halves are needed to know the noise; choose 2 or more")
    check_poses(camera_to_world, list(names))
    for pose, seed, name in zip(camera_to_world, seeds, names, strict=True):
        spp_half = math.ceil(spp / 2)
        a, b = (scene.colour(pose, spp_half, seed_from(seed, half)) for half in ("a", "b"))
        depth, normal = scene.geometry(pose, spp_half, seed_from(seed, "geometry"))
        finite = np.isfinite(a).all(-1) & np.isfinite(b).all(-1) & np.isfinite(depth) & np.isfinite(normal).all(-1)
        if not finite.all():
            raise RenderError(f"{name}: {int((~finite).sum())} of {finite.size} pixels are not finite; fix the scene")
        yield RenderedView(
            rgba=((a + b) / 2).astype(np.float32),
            variance=((a - b) ** 2 / 4).astype(np.float32),
            depth=depth.astype(np.float32),
            normal=normal.astype(np.float32),
            noise_mse=display_noise(a, b),
        )


def display_noise(a: np.ndarray, b: np.ndarray) -> float:
    """Return the mean square noise of the mean of two independent estimates [h, w, 4], in display colour over white."""
    display_a, display_b = (over_white(display_from_linear(half)).astype(np.float64) for half in (a, b))
    return float(np.mean((display_a - display_b) ** 2) / 4)


def even_spp(spp: int) -> int:
    """Return the smallest sample count ≥ `spp` that fits the sampler's grid of strata."""
    columns = math.isqrt(spp)
    return columns * math.ceil(spp / columns)


def seed_from(*parts: object) -> int:
    return int.from_bytes(hashlib.sha256(repr(parts).encode()).digest()[:4], "big")


def to_mitsuba(value: Any) -> Any:
    """Convert an entry of a description to the input of `mi.load_dict` (see `scenes.modelling.scene.Description`)."""
    import mitsuba as mi

    if isinstance(value, dict):
        if value.get("type") == "mesh":
            return _mesh(value)
        entry = {name: to_mitsuba(inner) for name, inner in value.items() if name != "data"}
        if "data" in value:
            pixels = np.ascontiguousarray(value["data"], dtype=np.float32)
            if value["type"] in ("bitmap", "envmap"):
                entry["bitmap"] = mi.Bitmap(pixels)
            elif value["type"] == "gridvolume":
                entry["grid"] = mi.VolumeGrid(pixels)
            else:
                raise RenderError(f"a {value['type']} with data: only bitmap, envmap and gridvolume may hold pixels")
        return entry
    if isinstance(value, np.ndarray):
        return mi.ScalarTransform4f(value.astype(np.float64)) if value.shape == (4, 4) else value.tolist()
    return value


def _mesh(entry: Description) -> Any:
    import mitsuba as mi

    unknown = set(entry) - {"type", "vertices", "faces", "uv", "normals", "bsdf", "interior", "exterior"}
    if unknown:
        raise RenderError(f"a mesh with {' '.join(sorted(unknown))}: known are vertices faces uv normals and bsdf")
    properties = mi.Properties()
    for name in ("bsdf", "interior", "exterior"):
        if name in entry:
            properties[name] = mi.load_dict(to_mitsuba(entry[name]))
    mesh = mi.Mesh("mesh", len(entry["vertices"]), len(entry["faces"]), properties, "normals" in entry, "uv" in entry)
    parameters = mi.traverse(mesh)
    names = {"vertices": "vertex_positions", "faces": "faces", "uv": "vertex_texcoords", "normals": "vertex_normals"}
    for name, parameter in names.items():
        if name in entry:
            dtype = np.uint32 if name == "faces" else np.float32
            parameters[parameter] = np.ascontiguousarray(entry[name], dtype=dtype).ravel()
    parameters.update()
    return mesh
