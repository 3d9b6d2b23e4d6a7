"""The emission–absorption integral by Mitsuba's own plugins: a reference that shares no code with `baselines`.

Media of Mitsuba 3.9 cannot glow. But a medium of extinction s = σ/2 and albedo c, seen along a ray *and* lit along the
same ray by parallel light of irradiance E = 8π, with isotropic single scattering only, has the radiance

    ∫ exp(−2∫s) · s · c · (1 / 4π) · E dt = ∫ exp(−∫σ) σ c dt,

which is what a radiance field of density σ and colour c shows on black. `volpath` estimates it by tracking; Dr.Jit
evaluates it deterministically on Mitsuba's `gridvolume`, and differentiates it.

The medium fills the unit cube; grids are [z, y, x] and [z, y, x, 3], their values at cell centres.
"""

import math
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np

from scenes.rendering.render import even_spp, seed_from, use
from scenes.rendering.variant import Variant

SINGLE_SCATTERING = 2
"""The `max_depth` of `volpath` with one scattering event."""
NO_ROULETTE = 100
BATCHES = 32
"""The number of independent batches of paths, whose spread gives the standard error."""
PADDED = 0.6
"""The half-extent of the boundary around the medium's half of 0.5: rays that enter a tight boundary skip the first
2e-4 of the medium (Mitsuba's ray epsilon), which costs 7 % at σ = 1000.
"""


@dataclass(frozen=True)
class Estimate:
    """An estimate of the radiance of one ray, red, green and blue."""

    mean: np.ndarray
    standard_error: np.ndarray
    paths: int


def tracked(
    sigma: np.ndarray, colour: np.ndarray, origin: np.ndarray, direction: np.ndarray, paths: int, variant: Variant
) -> Estimate:
    """Estimate by `volpath` along the ray `origin` + t `direction` (unit) with about `paths` paths."""
    mi = use(variant)
    spp = even_spp(math.ceil(paths / BATCHES))
    integrator = {"type": "volpath", "max_depth": SINGLE_SCATTERING, "rr_depth": NO_ROULETTE}
    irradiance = {"type": "rgb", "value": [8.0 * math.pi] * 3}
    light = {"type": "directional", "direction": direction.tolist(), "irradiance": irradiance}
    interior = {
        "type": "heterogeneous", "sigma_t": _grid(mi, sigma[..., None] / 2.0), "albedo": _grid(mi, colour),
        "has_spectral_extinction": False, "phase_function": {"type": "isotropic"},
    }  # fmt: skip
    to_world = mi.ScalarTransform4f().translate([0.5, 0.5, 0.5]).scale(PADDED)
    medium = {"type": "cube", "to_world": to_world, "bsdf": {"type": "null"}, "interior": interior}
    scene = mi.load_dict({"type": "scene", "integrator": integrator, "light": light, "medium": medium})
    film = {
        "type": "hdrfilm", "width": 1, "height": 1, "rfilter": {"type": "box"}, "pixel_format": "rgb",
        "component_format": "float32",
    }  # fmt: skip
    sensor = mi.load_dict(
        {
            "type": "radiancemeter", "origin": origin.tolist(), "direction": direction.tolist(), "film": film,
            "sampler": {"type": "independent", "sample_count": spp},
        }
    )  # fmt: skip
    seeds = [seed_from(float(sigma.sum()), batch) for batch in range(BATCHES)]
    images = [np.array(mi.render(scene, sensor=sensor, seed=seed, spp=spp), dtype=np.float64) for seed in seeds]
    seen = np.array(images).reshape(BATCHES, 3)
    return Estimate(seen.mean(axis=0), seen.std(axis=0, ddof=1) / math.sqrt(BATCHES), BATCHES * spp)


@dataclass(frozen=True)
class Differentiated:
    colour: np.ndarray
    """The colours, [rays, 3]."""
    d_sigma: np.ndarray
    """The gradient with respect to density, [z, y, x]."""
    d_colour: np.ndarray
    """The gradient with respect to colour, [z, y, x, 3]."""


def differentiated(
    sigma: np.ndarray, colour: np.ndarray, points: np.ndarray, delta: np.ndarray, weights: np.ndarray, variant: Variant
) -> Differentiated:
    """Apply midpoint quadrature on Mitsuba's `gridvolume` by Dr.Jit in float32, on black: `points` [rays, bins, 3]
    inside bins of length `delta` [rays, bins]; the gradient is that of the sum of colours times `weights` [rays, 3].

    Needs a variant that differentiates (not `scalar_rgb`).
    """
    mi = use(variant)
    import drjit as dr

    rays, bins = delta.shape
    density, hue = mi.load_dict(_grid(mi, sigma[..., None])), mi.load_dict(_grid(mi, colour))
    parameters = [mi.traverse(volume) for volume in (density, hue)]
    for volume in parameters:
        dr.enable_grad(volume["data"])
        volume.update()
    at = dr.zeros(mi.Interaction3f, rays * bins)
    at.p = mi.Point3f(*(mi.Float(points[..., axis].ravel().astype(np.float32)) for axis in range(3)))
    tau = density.eval_1(at) * mi.Float(delta.ravel().astype(np.float32))
    through = dr.exp(-dr.block_prefix_reduce(dr.ReduceOp.Add, tau, bins, exclusive=True))
    w = through * (1.0 - dr.exp(-tau))
    seen = [dr.block_reduce(dr.ReduceOp.Add, w * channel, bins) for channel in hue.eval(at)]
    shares = [mi.Float(weights[:, channel].astype(np.float32)) for channel in range(3)]
    dr.backward(sum(dr.sum(channel * share) for channel, share in zip(seen, shares, strict=True)))
    d_sigma, d_colour = (np.array(dr.grad(volume["data"]), dtype=np.float64) for volume in parameters)
    return Differentiated(
        np.stack([np.array(dr.detach(channel), dtype=np.float64) for channel in seen], axis=-1),
        d_sigma.reshape(sigma.shape),
        d_colour.reshape(colour.shape),
    )


def _grid(mi: ModuleType, values: np.ndarray) -> dict[str, Any]:
    """Make a `gridvolume` over the unit cube: trilinear between cell centres, the border extended, in full float32."""
    grid = mi.VolumeGrid(np.ascontiguousarray(values, dtype=np.float32))
    look = {"raw": True, "filter_type": "trilinear", "wrap_mode": "clamp", "accel": False}
    return {"type": "gridvolume", "grid": grid, **look}
