"""A ball of even fog whose truth is exact, even where its light scatters many times.

Its albedo is 0 or 1 in each colour, and the sky has one radiance L in all directions. With albedo 1, light is in
equilibrium: the fog scatters as much into a ray as out of it, so a ray of transmittance T carries L, of which T L comes
from the sky, which is not visible, and (1 − T) L from the fog. With albedo 0, the fog scatters nothing.
"""

import numpy as np

from scenes.catalog.stress import geometry
from scenes.catalog.stress.patterns import rgb, sky
from scenes.modelling.scene import Description, Scene
from scenes.modelling.truth import Seen

RADIUS = 0.9
SKY = 0.5
"""The radiance of the sky, well below white so that noise is not clipped on one side."""
DENSE, THIN = 50.0, 1e-3
"""The optical depths along a diameter."""
RED, BLACK = (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)
"""The albedos. Black fog of any density renders quickly: nothing scatters."""


def density(tau: float) -> float:
    """Return σ of fog whose diameter has that optical depth, 1 / scene unit."""
    return tau / (2 * RADIUS)


def fog(name: str, title: str, tau: float, albedo: tuple[float, float, float] = BLACK) -> Scene:
    """Make a ball of fog with optical depth `tau` along its diameter and an `albedo` of 0 or 1 in each colour."""

    def build() -> Description:
        medium = {"type": "homogeneous", "sigma_t": density(tau), "albedo": rgb(*albedo)}
        ball = {"type": "sphere", "radius": RADIUS, "bsdf": {"type": "null"}, "interior": medium}
        return {"sky": sky(SKY), "fog": ball}

    def truth(o: np.ndarray, d: np.ndarray) -> Seen:
        enter, leave = geometry.ball(o, d, geometry.ORIGIN, RADIUS)
        met = np.isfinite(enter) & (leave > 0)
        chord = np.where(met, np.where(met, leave, 0.0) - np.where(met, np.maximum(enter, 0.0), 0.0), 0.0)
        alpha = -np.expm1(-density(tau) * chord)
        depth = np.where(np.isfinite(enter) & (enter > 0), enter, 0.0)
        return Seen(SKY * alpha[:, None] * np.array(albedo), alpha, depth)

    # light that enters at the surface scatters (2/3) τ times on average; one in e of the long paths lasts for another
    # 0.076 τ² events (the slowest mode of diffusion in a ball), so a thousandth of these few is cut off
    max_depth = 64 + int(tau**2 / 2) if any(albedo) else 4
    return Scene(name, title, build, max_depth=max_depth, truth=truth)


SCENES = [
    fog("fog_dense", "Black fog of optical depth 50: stiff, as good as a wall with a soft rim", DENSE),
    fog("fog_thin", "Red fog of optical depth 0.001: there, but below what eight bits can tell", THIN, RED),
]
