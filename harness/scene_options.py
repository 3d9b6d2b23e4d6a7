"""Options that say where images come from, if not from the catalogue of scenes."""

import argparse
from pathlib import Path
from typing import Any

from harness.limits import RENDER_LIMIT
from scenes.errors import InputError


def add_options(command: argparse.ArgumentParser) -> None:
    """Images, or a scene to render, of the user's own."""
    add = command.add_argument
    add(
        "--view-set",
        type=Path,
        nargs="+",
        metavar="PATH",
        help="train on these images, a scene each: a folder in the Blender format or nerfstudio's, a tiny-NeRF .npz",
    )
    add(
        "--scene-file",
        type=Path,
        metavar="FILE",
        help="render your own scene instead: Mitsuba .xml, or .py with SCENE. It has your rights: Python is code, "
        "and an XML file can make Mitsuba read any file; use what you trust",
    )
    add(
        "--render-limit",
        type=float,
        metavar="S",
        help="seconds that --scene-file, or one of its views, may take "
        f"(default: {RENDER_LIMIT:g}, more where views are large)",
    )
    corners = ("X0", "Y0", "Z0", "X1", "Y1", "Z1")
    add("--bounds", nargs=6, type=float, metavar=corners, help="box that holds what is seen, for every --view-set")
    add("--near", type=float, metavar="D", help="distance from the camera at which anything is seen, for --view-set")
    add("--far", type=float, metavar="D", help="distance up to which anything is seen, for --view-set")


def chosen(options: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `harness.plan.planned`; raises `InputError` for numbers that are no region."""
    from scenes.source import Region

    given = [f"--{name}" for name in ("bounds", "near", "far") if getattr(options, name) is not None]
    if given and options.view_set is None:
        raise InputError(f"{' '.join(given)}: only for --view-set; what we render says where it lies")
    try:
        region = Region(tuple(options.bounds) if options.bounds else None, options.near, options.far)
    except InputError as error:
        raise InputError(f"{' '.join(given)}: {error}") from error
    return {
        "view_set": options.view_set,
        "scene_file": options.scene_file,
        "render_limit": options.render_limit,
        "region": region if given else None,
    }
