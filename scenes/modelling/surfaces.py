"""Materials by their look, as Mitsuba BSDF dictionaries.

A colour is linear RGB, or a texture where one is accepted. Thin sheets, seen from either side, go through
`both_sides`; closed bodies need not.
"""

from collections.abc import Sequence

import numpy as np

from scenes.modelling.scene import Description
from scenes.view_sets.pixels import decode_srgb

Colour = Sequence[float] | Description


def reflectance(colour: Colour) -> Description:
    """Return a colour in Mitsuba's form; a texture is returned unchanged."""
    return colour if isinstance(colour, dict) else {"type": "rgb", "value": [float(part) for part in colour]}


def srgb(code: str) -> tuple[float, float, float]:
    """Return the linear RGB of a display colour such as `#f0c010`."""
    display = np.array([int(code[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    red, green, blue = (float(part) for part in decode_srgb(display))
    return red, green, blue


def texture(pixels: np.ndarray, repeat: float = 1.0) -> Description:
    """A bitmap [h, w, 3] of linear RGB over the unit square of `uv`, repeated that often each way."""
    picture: Description = {"type": "bitmap", "data": pixels.astype(np.float32), "filter_type": "bilinear"}
    if repeat != 1.0:
        picture["to_uv"] = np.diag([repeat, repeat, 1.0, 1.0])
    return picture


def both_sides(bsdf: Description) -> Description:
    return {"type": "twosided", "bsdf": bsdf}


def matte(colour: Colour) -> Description:
    """Paper, chalk, stone, dull paint."""
    return {"type": "diffuse", "reflectance": reflectance(colour)}


def cloth(colour: Colour, sheen: float = 0.6) -> Description:
    """Woven or felted cloth: brightens towards grazing angles."""
    look = {"roughness": 0.85, "specular": 0.25, "sheen": sheen, "sheen_tint": 0.5}
    return {"type": "principled", "base_color": reflectance(colour), **look}


VARNISH, RUBBER, GLAZE = 0.08, 0.45, 0.0
"""The roughness of the coats of polished wood, of rubber and of ceramic."""
BLACK_RUBBER = (0.018, 0.018, 0.02)


def plastic(colour: Colour, roughness: float) -> Description:
    """A coloured body under a clear coat; roughness 0 is a mirror-smooth coat."""
    kind: Description = {"type": "roughplastic", "alpha": roughness} if roughness else {"type": "plastic"}
    return kind | {"diffuse_reflectance": reflectance(colour)}


METALS: dict[str, Description] = {
    "aluminium": {"material": "Al"},
    "copper": {"material": "Cu"},
    "gold": {"material": "Au"},
    "silver": {"material": "Ag"},
    # Mitsuba has no table for these: CuZn as measured near 630, 545 and 460 nm, and a redder alloy
    "brass": {"eta": reflectance((0.444, 0.527, 1.094)), "k": reflectance((3.695, 2.765, 1.829))},
    "bronze": {"eta": reflectance((0.35, 0.60, 1.10)), "k": reflectance((3.6, 2.3, 1.75))},
}


def metal(name: str, roughness: float = 0.0) -> Description:
    """A metal of `METALS`; roughness 0 is a mirror. Aluminium looks like whitish steel."""
    kind: Description = {"type": "conductor"}
    if roughness:
        kind = {"type": "roughconductor", "alpha": roughness, "distribution": "ggx"}
    return kind | METALS[name]


def glass(index: float = 1.5, roughness: float = 0.0) -> Description:
    """A solid body that refracts; give it a closed, outward-facing mesh."""
    kind: Description = {"type": "roughdielectric", "alpha": roughness} if roughness else {"type": "dielectric"}
    return kind | {"int_ior": index, "ext_ior": 1.0}


def pane(index: float = 1.5) -> Description:
    """A clear sheet without thickness: reflects a little, does not bend light."""
    return {"type": "thindielectric", "int_ior": index, "ext_ior": 1.0}


def veil(opacity: float, bsdf: Description) -> Description:
    """Make a share `opacity` of the material opaque, the rest transparent: gauze, frosted film, a drum skin."""
    return {"type": "mask", "opacity": float(opacity), "bsdf": bsdf}


def mottle(seed: int, height: int = 128, width: int = 128, coarseness: float = 1.8) -> np.ndarray:
    """Return a cloudy pattern 0 … 1, [height, width], that tiles: noise with amplitude 1 / frequency ^ coarseness."""
    frequency = np.hypot(np.fft.fftfreq(height)[:, None] * height, np.fft.fftfreq(width) * width)
    frequency[0, 0] = np.inf
    spectrum = np.fft.fft2(np.random.default_rng(seed).normal(size=(height, width)))
    field: np.ndarray = np.real(np.fft.ifft2(spectrum / frequency**coarseness))
    return np.asarray(np.clip(0.5 + field / (5 * field.std()), 0.0, 1.0))


def mixed(first: Sequence[float], second: Sequence[float], share: np.ndarray) -> np.ndarray:
    """Return pixels [h, w, 3] between two colours, by the share [h, w] of the second."""
    return np.asarray((1 - share)[..., None] * np.asarray(first) + share[..., None] * np.asarray(second))


def tinted(clear: Description, colour: Sequence[float]) -> Description:
    """A glass or water that tints the light each time it passes its surface."""
    return clear | {"specular_transmittance": reflectance(colour)}


def thin(colour: Colour, translucency: float, roughness: float) -> Description:
    """A leaf, sailcloth, paper: a sheet without thickness that lets that share of its light glow through."""
    look = {"roughness": roughness, "spec_trans": 0.0, "diff_trans": 2.0 * translucency, "eta": 1.4}
    return {"type": "principledthin", "base_color": reflectance(colour), **look}
