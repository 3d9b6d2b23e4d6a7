"""The parts of a method, its renderer and its scores that a scene requires, derived only from its description.

Each part has a bound on what leaving it out may cost; `harness.studies.choices.omissions` measures whether it holds.
"""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Literal

import numpy as np

from scenes.modelling.scene import Description

if TYPE_CHECKING:
    from scenes.view_sets.view_set import ViewSet

LAMBERTIAN = frozenset({"diffuse", "null", "twosided", "mask", "bumpmap", "normalmap", "blendbsdf"})
"""The BSDFs that look the same from every side; wrappers only if their contents do."""
MEDIA = frozenset({"homogeneous", "heterogeneous"})
SHAPES = frozenset(
    {
        "mesh", "sphere", "cube", "rectangle", "disk", "cylinder", "obj", "ply", "serialized", "sdfgrid",
        "bsplinecurve", "linearcurve", "shapegroup", "instance", "merge",
    }
)  # fmt: skip
_NO_BSDF = SHAPES | {
    "scene", "ref", "constant", "envmap", "directional", "area", "point", "spot", "rgb", "spectrum", "uniform", "srgb",
    "bitmap", "checkerboard", "mesh_attribute", "volume", "gridvolume", "constvolume", "homogeneous", "heterogeneous",
    "isotropic", "hg",
}  # fmt: skip

Unit = Literal["dB", "colour"]


@dataclass(frozen=True)
class Part:
    what: str
    """The work that is saved where the part is not needed."""
    concerns: Literal["model", "sampling", "rendering", "metrics"]
    bound: float
    """The bound on how much worse the result may get without it: dB of test PSNR, or a display colour 0 … 1."""
    unit: Unit


SMALLEST_DB = 0.2
"""The difference in dB below which no verdict of the harness sees one."""
PARTS: dict[str, Part] = {
    "view_direction": Part("view-direction branch", "model", SMALLEST_DB, "dB"),
    "background_model": Part("background model", "model", 0.0, "colour"),
    "high_bands": Part("bands above the Nyquist limit", "model", SMALLEST_DB, "dB"),
    "every_bin": Part("every second bin", "sampling", SMALLEST_DB, "dB"),
    "outside_box": Part("samples outside the box", "sampling", SMALLEST_DB, "dB"),
    "empty_space": Part("samples in empty space", "sampling", SMALLEST_DB, "dB"),
    "outside_hull": Part("samples outside the silhouettes", "sampling", SMALLEST_DB, "dB"),
    "behind_matter": Part("training samples behind matter", "sampling", SMALLEST_DB, "dB"),
    "background_rays": Part("most rays through background", "sampling", SMALLEST_DB, "dB"),
    "fine_pass": Part("hierarchical (fine) pass", "sampling", SMALLEST_DB, "dB"),
    "linear_quadrature": Part("quadrature linear in τ", "sampling", SMALLEST_DB, "dB"),
    "behind_opaque": Part("samples behind opaque matter", "rendering", 1e-4, "colour"),
    "participating_media": Part("volumetric integrator", "rendering", 1 / 510, "colour"),
    "scale_checks": Part("normalising the scale", "rendering", 1 / 510, "colour"),
    "hdr_metrics": Part("logarithmic error metrics", "metrics", 0.0, "dB"),
    "depth_metric": Part("depth error", "metrics", 0.0, "dB"),
}
"""The parts by name, which is stable; `what` is read by people.

`behind_opaque` is the transmittance at which a ray ends, times the largest display colour; 1/510 is half an 8-bit
step. A part that no score depends on, or that is exact, has bound 0.
"""

BINS = 64
"""The bins of a ray through the box, for the τ per bin: the coarse pass of the original NeRF."""
OPAQUE_TAU = -math.log(1e-4)
LARGEST_RATIO = 1e2
"""The ratio of brightest to median above which an error in display colour says little about the bright part."""
SCALES = (1e-2, 1e2)
"""The sizes and distances from the origin at which Mitsuba's own ray epsilon is negligible."""
UNSUPPORTED = frozenset({"linear_quadrature"})
"""The parts that no method has: the need is reported, but nothing is left out."""
KEPT = {"high_bands": "the bands are what is compared; see nerf_matched"}


@dataclass(frozen=True)
class Need:
    name: str
    needed: bool
    reason: str
    kept: str = ""
    """The reason why the part is kept although it is not needed."""

    @property
    def part(self) -> Part:
        return PARTS[self.name]


Needs = dict[str, Need]
"""The needs by name, in the order of `PARTS`; unknown needs are missing."""


def needs(
    description: Description,
    bounds: np.ndarray | None = None,
    pixel: float | None = None,
    described: np.ndarray | None = None,
) -> Needs:
    """Return the needs of a description as it is rendered, in the box `bounds` [2, 3].

    `pixel` is the length of a pixel in the middle of the box, in scene units, and `described` the box before
    normalisation. An unknown type of BSDF counts as dependent on direction. Without `bounds` or `pixel`, the needs that
    follow from them are missing.
    """
    types = {entry["type"] for entry in entries(description) if "type" in entry}
    media, shiny = sorted(types & MEDIA), sorted(types - LAMBERTIAN - _NO_BSDF)
    direction = "every surface is Lambertian and lit statically"
    if shiny:
        direction = f"not Lambertian: {' '.join(shiny)}"
    elif media:
        direction = f"light scattered on its way through a medium: {' '.join(media)}"
    surfaces = _surfaces(description)
    containers = [entry for entry in entries(description) if entry.get("type") in SHAPES and "interior" in entry]
    no_depth = "a medium has no depth" if containers else "nothing has a depth"
    known: dict[str, tuple[bool, str]] = {
        "view_direction": (bool(shiny or media), direction),
        "background_model": (False, "no sky is seen, so alpha is known"),
        "participating_media": (bool(media), f"media: {' '.join(media)}" if media else "no participating medium"),
        "hdr_metrics": _hdr_metrics(description),
        "depth_metric": (bool(surfaces), "surfaces have a depth" if surfaces else no_depth),
    }
    if bounds is not None:
        low, high = (" ".join(f"{value:.2f}" for value in corner) for corner in bounds)
        known["outside_box"] = (False, f"everything lies between ({low}) and ({high})")
        full = not surfaces and any(entry["type"] == "cube" for entry in containers)
        empty = "surfaces fill no space: most of the box is empty" if surfaces else "nothing fills the box"
        known["empty_space"] = (full, "a medium fills the box" if full else empty)
        box = bounds if described is None else described
        size, away = float(np.ptp(box, axis=0).max()) / 2, float(np.abs(box.mean(axis=0)).max())
        usual = SCALES[0] <= size <= SCALES[1] and away <= SCALES[1]
        known["scale_checks"] = (not usual, f"half-extent {size:.3g}, {away:.3g} from the origin")
        known |= _along_rays(description, bounds)
        if pixel:
            cycles = float((bounds[1] - bounds[0]).max()) / pixel / 2
            bands = f"{useful_bands(cycles, 2.0)} of 2^k or {useful_bands(cycles, 1.618034)} of φ^k"
            reason = f"pixels show {cycles:.0f} cycles across the box: bands {bands} reach that far"
            known["high_bands"] = (False, reason)
    return {name: Need(name, *known[name], KEPT.get(name, "")) for name in PARTS if name in known}


def left_out(known: Needs) -> list[dict[str, object]]:
    """Return plain data on what is left out: `{"name", "what", "reason", "concerns", "bound", "unit"}`."""
    omitted = [need for need in known.values() if not need.needed and not need.kept and need.name not in UNSUPPORTED]
    # in the order of the keys that manifests have
    return [{"name": need.name, "what": need.part.what, "reason": need.reason, **asdict(need.part)} for need in omitted]


def part_name(what: str, name: str = "") -> str:
    """Return the name of the part in a row of `left_out`, in older ones from `what`; empty for an unknown part."""
    return name or next((known for known, part in PARTS.items() if part.what == what), "")


def as_rows(known: Needs) -> list[dict[str, object]]:
    return [asdict(need) for need in known.values()]


def needs_of(views: "ViewSet") -> Needs:
    """Return the needs of a view set; empty if it was not rendered here, or by an older version."""
    rows = views.rendered.get("needs")
    return {row["name"]: Need(**row) for row in rows} if isinstance(rows, list) else {}


def with_needs(views: "ViewSet", need: tuple[str, ...], no_need: tuple[str, ...]) -> "ViewSet":
    """Return the same images, with parts forced in or out, without depth if nothing has one, and with the light of the
    test views if display colour cannot hold it.
    """
    if need or no_need:
        known = needs_of(views) | {name: Need(name, True, "forced in by --need") for name in need}
        known |= {name: Need(name, False, "forced out by --no-need") for name in no_need}
        known = {name: known[name] for name in PARTS if name in known}
        views = replace(views, rendered={**views.rendered, "needs": as_rows(known), "left_out": left_out(known)})
    depth = needs_of(views).get("depth_metric")
    if depth is not None and not depth.needed:
        views = replace(views, val=replace(views.val, depth=None), test=replace(views.test, depth=None))
    bright = needs_of(views).get("hdr_metrics")
    if bright is not None and bright.needed:
        from scenes.view_sets.view_set import linear_over_white

        views = replace(views, test=replace(views.test, light=partial(linear_over_white, views)))
    return views


def useful_bands(cycles: float, base: float) -> int:
    """Return the number of bands of an encoding b^k, k < L, that show `cycles` across the box; more only add noise."""
    return max(1, math.ceil(math.log(max(cycles, 1.0), base)))


def _along_rays(description: Description, bounds: np.ndarray) -> dict[str, tuple[bool, str]]:
    """Return the needs that depend on how much geometry a ray and one of its bins meet."""
    if _surfaces(description):
        return {
            "fine_pass": (True, "a surface is thinner than any bin: samples must be drawn to it"),
            "linear_quadrature": (True, "a surface is opaque within a bin"),
            "behind_opaque": (False, "nothing is seen behind an opaque surface"),
        }
    tau = float(np.linalg.norm(bounds[1] - bounds[0])) * _largest_extinction(description)
    in_bin = (tau / BINS > 1.0, f"τ of a bin is at most {tau / BINS:.3g}")
    opaque, reason = tau >= OPAQUE_TAU, f"τ along a ray is at most {tau:.3g}"
    behind = (not opaque, reason if opaque else f"{reason}: every sample counts")
    return {"fine_pass": in_bin, "linear_quadrature": in_bin, "behind_opaque": behind}


def _hdr_metrics(description: Description) -> tuple[bool, str]:
    around, glowing = np.empty(0), np.empty(0)
    for entry in entries(description):
        if entry.get("type") == "envmap" and "data" in entry:
            around = np.append(around, _luminances(entry["data"]) * float(entry.get("scale", 1.0)))
        elif entry.get("type") == "constant":
            around = np.append(around, _luminances(_numbers(entry.get("radiance", 1.0))))
        elif entry.get("type") == "area":
            glowing = np.append(glowing, _luminances(_numbers(entry.get("radiance", 1.0))))
    brightest = float(np.append(around, glowing).max(initial=0.0))
    if brightest == 0.0:
        return False, "no light that is measured in radiance"
    if len(around):
        usual = float(np.median(around))
    else:
        # a surface that does not glow reflects no more than its albedo of the light on it
        albedos = [_largest_albedo(shape) for shape in _surfaces(description) if not glows(shape)]
        usual = float(np.median(glowing)) * min([1.0, *albedos])
    ratio = brightest / usual if usual > 0 else math.inf
    return ratio > LARGEST_RATIO, f"brightest over usual light: {ratio:.3g}"


def _largest_albedo(shape: Description) -> float:
    names = ("reflectance", "diffuse_reflectance", "base_color")
    values = [_numbers(entry[name]).max(initial=0.0) for entry in entries(shape) for name in names if name in entry]
    return float(max(values, default=1.0))


def _surfaces(description: Description) -> list[Description]:
    """Return the shapes that are visible themselves, excluding those that only hold a medium."""
    return [
        entry
        for entry in entries(description)
        if entry.get("type") in SHAPES and (glows(entry) or not _holds(entry, "null"))
    ]


def _holds(shape: Description, kind: str) -> bool:
    return any(isinstance(value, dict) and value.get("type") == kind for value in shape.values())


def glows(shape: Description) -> bool:
    return _holds(shape, "area")


def _largest_extinction(description: Description) -> float:
    """Return the largest σ_t per scene unit, 0 without media."""
    largest = 0.0
    for entry in entries(description):
        if entry.get("type") in MEDIA:
            parts = [entry["sigma_t"]] if "sigma_t" in entry else [entry.get("sigma_a", 0.0), entry.get("sigma_s", 0.0)]
            total = sum(float(_numbers(part).max(initial=0.0)) for part in parts if part is not None)
            largest = max(largest, total * float(entry.get("scale", 1.0)))
    return largest


def _numbers(value: object) -> np.ndarray:
    """Return the numbers of a colour, a texture or a volume, flat or [..., channels]."""
    if isinstance(value, dict):
        for key in ("data", "value", "color", "grid"):
            if key in value:
                return _numbers(value[key])
        return np.zeros(0)
    return np.atleast_1d(np.asarray(value, dtype=np.float64))


def _luminances(values: np.ndarray) -> np.ndarray:
    """Return the mean of the channels, flat; a single number is grey."""
    values = np.asarray(values, dtype=np.float64)
    return values.mean(axis=-1).ravel() if values.ndim and values.shape[-1] in (3, 4) else values.ravel()


def entries(description: Description) -> Iterator[Description]:
    """Yield the description and every dictionary inside it."""
    yield description
    for value in description.values():
        if isinstance(value, dict):
            yield from entries(value)
