"""The same Gaussians, traced and differentiated by Mitsuba: its shape `ellipsoids` and integrator `volprim_rf_basic`,
which composites the largest value of each Gaussian along a ray (Moenne-Loccoz et al. 2024, arXiv 2407.07090).

Importing this module imports Mitsuba and sets its variant; a renderer may set another between two uses of a scene.
"""

from typing import Any, no_type_check

import drjit as dr
import mitsuba as mi
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

VARIANT = "llvm_ad_rgb"
mi.set_variant(VARIANT)

from mitsuba.python.ad.integrators.volprim_rf_basic import (  # noqa: E402 — of the variant that is set
    BasicVolumetricPrimitiveRadianceFieldIntegrator,
)

MOST_HITS = 128
END = 0.01
"""The transmittance below which a ray ends, as in Mitsuba."""
TINY = 1e-4
"""The distance behind a Gaussian at which a ray resumes, as in Mitsuba."""
NAMES = ("shape.data", "shape.opacities", "shape.sh_coeffs")
"""Centre, scales, and a unit quaternion x, y, z, w; opacity; harmonics, red, green and blue of one after the other."""


class OverWhite(BasicVolumetricPrimitiveRadianceFieldIntegrator):  # type: ignore[misc]
    """Mitsuba's integrator, with the outputs that it lacks: the background and the depth."""

    @dr.syntax
    @no_type_check
    def seen(self, scene: Any, ray: Any) -> tuple[Any, Any, Any, Any]:
        """Return radiance over white, transmittance, distance times opacity, and hits: `sample` without a gradient."""
        start, ray = mi.Point3f(ray.o), mi.Ray3f(ray)
        radiance, let = mi.Color3f(0.0), mi.Float(1.0)
        distance, hits, active = mi.Float(0.0), mi.UInt32(0), mi.Bool(True)
        while active:
            si = scene.ray_intersect(ray, coherent=False, ray_flags=mi.RayFlags.All, active=active)
            active &= si.is_valid()
            emission, through = self.eval_sh_emission(si, ray, active), self.eval_transmission(si, ray, active)
            weight = dr.select(active, let * (1.0 - through), 0.0)
            radiance += dr.select(active, weight * emission, 0.0)
            distance += dr.select(active, weight * dr.dot(self.peak(si, ray, active) - start, ray.d), 0.0)
            let -= weight
            ray.o = dr.select(active, si.p + ray.d * TINY, ray.o)
            hits += dr.select(active, mi.UInt32(1), mi.UInt32(0))
            active &= (let > END) & (hits < MOST_HITS)
        return radiance + let, let, distance, hits

    @no_type_check
    def peak(self, si: Any, ray: Any, active: Any) -> Any:
        """Return the point of a ray at which `eval_transmission` evaluates a Gaussian, that of its largest density; a
        hit lies at the border of its extent.
        """

        def numbers(shape: Any, primitive: Any, active: Any) -> tuple[Any, Any, Any]:
            if shape is None or not shape.is_ellipsoids():
                return mi.Point3f(0), mi.Vector3f(0), mi.Matrix3f(0)
            met = dr.zeros(mi.SurfaceInteraction3f)
            met.prim_index = primitive
            data = shape.eval_attribute_x("ellipsoid", met, active)
            rotation = dr.quat_to_matrix(mi.Matrix3f, mi.Quaternion4f([data[k + 6] for k in range(4)]))
            return mi.Point3f([data[k] for k in range(3)]), mi.Vector3f([data[k + 3] for k in range(3)]), rotation

        centre, scale, rotation = dr.dispatch(si.shape, numbers, si.prim_index, active)
        o, d = rotation.T * (ray.o - centre) / scale, rotation.T * ray.d / scale
        return ray(-dr.dot(o, d) / dr.dot(d, d))


class Traced:
    """A scene of a fixed number of Gaussians in Mitsuba; lengths are as in `baselines.splats.gaussians`."""

    def __init__(self, numbers: tuple[Tensor, ...]) -> None:
        """Take numbers as `NAMES` lists them, each [gaussians, numbers]."""
        _set_variant()
        self.count = len(numbers[0])
        self.integrator = OverWhite(mi.Properties("volprim_rf_basic"))
        self.integrator.srgb_primitives = False
        self.integrator.max_depth = mi.UInt32(MOST_HITS)
        data, opacities, harmonics = (part.detach().numpy() for part in numbers)
        shape = {
            "type": "ellipsoids",
            "centers": mi.TensorXf(data[:, :3]),
            "scales": mi.TensorXf(data[:, 3:6]),
            "quaternions": mi.TensorXf(data[:, 6:]),
            "opacities": mi.TensorXf(opacities),
            "sh_coeffs": mi.TensorXf(harmonics),
            "extent_adaptive_clamping": True,
        }
        self.scene = mi.load_dict({"type": "scene", "shape": shape})
        self.parameters = mi.traverse(self.scene)
        self.sampler = mi.load_dict({"type": "independent"})

    def move(self, numbers: tuple[Tensor, ...]) -> None:
        _set_variant()
        for name, part in zip(NAMES, numbers, strict=True):
            self.parameters[name] = mi.Float(part.detach().numpy().ravel())
        self.parameters.update()

    def trace(
        self, origins: Float[Tensor, "rays 3"], directions: Float[Tensor, "rays 3"]
    ) -> tuple[Float[Tensor, "rays 3"], Float[Tensor, " rays"], Float[Tensor, " rays"], int]:
        """Return colour over white, transmittance, distance times opacity, and the number of Gaussians met."""
        _set_variant()
        colour, let, distance, hits = self.integrator.seen(self.scene, _ray(origins, directions))
        dr.eval(colour, let, distance, hits)
        return _tensor(colour).T.contiguous(), _tensor(let), _tensor(distance), int(np.array(hits).sum())

    def gradient(
        self,
        origins: Float[Tensor, "rays 3"],
        directions: Float[Tensor, "rays 3"],
        colour: Float[Tensor, "rays 3"],
        to_colour: Float[Tensor, "rays 3"],
    ) -> tuple[Tensor, ...]:
        """Return the gradient of the numbers, given that of the `colour` that `trace` returned.

        The loop runs once more along the same path, and computes the light from behind each Gaussian by subtraction.
        """
        _set_variant()
        for name in NAMES:
            dr.enable_grad(self.parameters[name])
        ray, slope, state = _ray(origins, directions), _colour(to_colour), _colour(colour)
        self.sampler.seed(0, len(origins))
        with dr.suspend_grad():  # except where the integrator itself resumes gradients
            self.integrator.sample(dr.ADMode.Backward, self.scene, self.sampler, ray, slope, state, True)
        gradients = tuple(_tensor(dr.grad(self.parameters[name])).view(self.count, -1) for name in NAMES)
        for name in NAMES:
            dr.disable_grad(self.parameters[name])
        return gradients


def _set_variant() -> None:
    """Set the variant of the process again if a renderer has changed it: the names of `mi` are those of its variant."""
    if mi.variant() != VARIANT:
        mi.set_variant(VARIANT)


def _tensor(values: Any) -> Tensor:
    return torch.from_numpy(np.array(values))


def _colour(values: Tensor) -> Any:
    return mi.Color3f(values.detach().numpy().T.copy())


def _ray(origins: Tensor, directions: Tensor) -> Any:
    return mi.Ray3f(mi.Point3f(origins.numpy().T.copy()), mi.Vector3f(directions.numpy().T.copy()))
