"""A page that holds the picture comparer alone, with pictures made by hand: what the comparer is tested on.

python -m tests.reports.comparer_page FILE    writes one with two scenes, to be looked at
"""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from reports.data.packing import Packed, as_data, depth, display, light
from reports.drawing import palette
from reports.page import script as page_script
from reports.page import shell
from reports.page.script import content_policy, script
from reports.run import pictures
from scenes.view_sets.pixels import encode_srgb

METHODS = ("nerf", "nerf_matched", "qnerf")
STEPS = (100, 400, 1600)
FILES = ("state.js", "element.js", "numbers.js", "download.js", "filter.js", *pictures.SCRIPTS)
ALONE = ("element.js", "numbers.js", "chunks.js", "kept.js", "pixels.js", "colour_space.js", "delta_e.js", "flip.js")
"""What the arithmetic needs."""


@dataclass
class Held:
    """Packed pictures by name, as the page holds them."""

    texts: dict[str, str] = field(default_factory=dict)

    def add(self, picture: Packed) -> dict[str, Any]:
        """Return the description of a picture."""
        self.texts[picture.id] = picture.text
        return picture.ref


def ball(height: int, width: int, seed: int = 0, hdr: bool = False) -> dict[str, np.ndarray]:
    """A striped ball on white: display colour, linear light over white (brighter than 1 where hdr), opacity, depth."""
    y, x = np.mgrid[:height, :width]
    u, v = (x + 0.5) / width * 2 - 1, (y + 0.5) / height * 2 - 1
    rim = 0.64 - u**2 - v**2
    bump = np.sqrt(np.clip(rim, 0, None))
    stripes = 0.5 + 0.5 * np.sin(11 * u + 5 * v + seed)
    linear = np.stack([0.15 + 0.6 * stripes, 0.1 + 0.5 * bump, 0.5 - 0.4 * stripes], -1)
    if hdr:
        linear *= 1 + 40 * np.exp(-60 * ((u + 0.3) ** 2 + (v + 0.3) ** 2))[..., None]
    linear = np.where((rim > 0)[..., None], linear, 1.0)
    return {
        "display": encode_srgb(linear),
        "linear": linear,
        "opacity": (rim > 0).astype(float),
        "depth": np.where(rim > 0, 4 - bump, 0.0),
    }


def rendered(truth: dict[str, np.ndarray], method: int, seed: int, step: int) -> dict[str, np.ndarray]:
    """The truth as a method may have it at a step: with smooth noise, less of it later."""
    noise = np.random.default_rng([method, seed, step])
    size = 0.3 * (100 / step) ** 0.6 * (1 + 0.3 * method)
    rough = noise.normal(0, 1, truth["display"].shape)
    smooth = np.mean([np.roll(rough, (i, j), (0, 1)) for i in range(3) for j in range(3)], axis=0)
    return {
        "display": np.clip(truth["display"] + size * smooth, 0, 1),
        "opacity": np.clip(truth["opacity"] + 0.3 * size * smooth[..., 0], 0, 1),
        "depth": np.clip(np.where(truth["opacity"] > 0, truth["depth"], 6) + size * smooth[..., 1], 0, None),
    }


def data_of(
    packed: Held, side: int = 48, names: tuple[str, ...] = ("lego", "mic"), methods: tuple[str, ...] = METHODS
) -> dict[str, Any]:
    """Two scenes × two views × two seeds; the first seed has three steps, the second one the last alone. The first view
    of mic is HDR, the second one of lego has no true depth; the last method diverged with seed 1.
    """
    variables = {name: colour.variable for name, colour in palette.colours_of(list(methods)).items()}
    scenes = [_scene(packed, side, place, name, methods) for place, name in enumerate(names)]
    return {"methods": list(methods), "variables": variables, "scenes": scenes, "left_out": []}


def _scene(packed: Held, side: int, place: int, name: str, methods: tuple[str, ...]) -> dict[str, Any]:
    views, renders = [], []
    for view in range(2):
        width = side if view == 0 else side * 3 // 2
        truth = ball(side, width, 3 * place + view, hdr=(place, view) == (1, 0))
        views.append(_view(packed, f"r_{7 * view + 5}", truth, with_depth=(place, view) != (0, 1)))
        for number, method in enumerate(methods):
            for seed, step in [*((0, step) for step in STEPS), (1, STEPS[-1])]:
                if seed == 1 and method == methods[-1]:
                    continue
                made = rendered(truth, number, seed, step)
                about = {"method": method, "seed": seed, "step": step, "seconds": step * (0.02 + 0.002 * number)}
                renders.append(about | {"view": view} | _render(packed, made, truth, step == STEPS[-1]))
    reason = "not finite at step 412: head.weight"
    missing = [{"method": methods[-1], "seed": 1, "status": "diverged", "reason": reason}]
    return {"name": name, "title": name.title(), "views": views, "renders": renders, "missing": missing}


def _view(packed: Held, name: str, truth: dict[str, np.ndarray], with_depth: bool) -> dict[str, Any]:
    height, width = truth["opacity"].shape
    hdr = bool(truth["linear"].max() > 1)
    refs = {
        "display": packed.add(display(truth["display"])),
        "linear": packed.add(light(truth["linear"])) if hdr else None,
        "opacity": packed.add(display(truth["opacity"])),
        "depth": packed.add(depth(truth["depth"], 8.0)) if with_depth else None,
    }
    return {"name": name, "width": width, "height": height, "near": 2.0, "far": 6.0, "hdr": hdr, "truth": refs}


def _render(packed: Held, made: dict[str, np.ndarray], truth: dict[str, np.ndarray], last: bool) -> dict[str, Any]:
    error = float(np.mean((made["display"] - truth["display"]) ** 2))
    return {
        "last": last,
        "psnr": -10 * float(np.log10(error)) if last else None,
        "flip": 0.0815 if last else None,
        "delta_e": 3.25 if last else None,
        "colour": packed.add(display(made["display"])),
        "opacity": packed.add(display(made["opacity"])),
        "depth": packed.add(depth(made["depth"], 8.0)),
    }


def write_comparer_page(path: Path, data: dict[str, Any], packed: Held, beside: bool = False) -> Path:
    """The comparer's part of the page with the page's own style and policy; `beside`: which may load script files."""
    code = script(*FILES)
    pictures = "".join(
        f'<script type="application/octet-stream" id="{name}">{text}</script>\n' for name, text in packed.texts.items()
    )
    path.write_text(
        f"""<!doctype html><html lang="en"><head><meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{content_policy(code, beside)}">
<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">
<title>Pictures</title><style>{shell.style("page.css", "explore.css", "compare.css")}</style></head><body>
<div class="body"><nav></nav><main>
<section id="pictures"><h2>Pictures</h2><div id="comparer" hidden></div></section></main></div>
<script type="application/json" id="pictures-data">{as_data(data)}</script>
{pictures}<script>{code}</script></body></html>""",
        encoding="utf-8",
    )
    return path


def write_arithmetic_page(path: Path, body: str, packed: Held | None = None, given: Any = None) -> Path:
    """A page that runs the named scripts of ours and then `body`, which sets the document's title when it is done and
    leaves JSON in `#found`; `given` is its data.
    """
    code = "(() => {\n" + "\n".join(
        page_script.FILES[name].read_text(encoding="utf-8") for name in (*ALONE, "error_maps.js")
    )
    code += "\nconst given = element.data('given', null);\n"
    code += "const tell = (found) => { document.getElementById('found').textContent = JSON.stringify(found);"
    code += " document.title = 'done'; };\n" + body + "})();"
    pictures = "".join(
        f'<script type="application/octet-stream" id="{name}">{text}</script>'
        for name, text in (packed.texts if packed else {}).items()
    )
    path.write_text(
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><meta http-equiv="Content-Security-Policy" '
        f'content="{content_policy(code)}"><link rel="icon" href="data:,"></head><body><p id="found"></p>{pictures}'
        f'<script type="application/json" id="given">{as_data(given)}</script><script>{code}</script></body></html>',
        encoding="utf-8",
    )
    return path


if __name__ == "__main__":
    held = Held()
    write_comparer_page(Path(sys.argv[1]), data_of(held, 100), held)
