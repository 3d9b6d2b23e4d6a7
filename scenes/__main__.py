"""`python -m scenes render | export | noise | …`: a separate process, which Dr.Jit may end.

`render` prints one JSON object per line: `{"scene", "done", "total", "kept", "share", "view"}`
(`scenes.rendering.writer`) after loading and after each view, then `{"scene", "path", "variant", "seconds"}`; for a
scene from a file `{"scene", "note"}` first. Exit codes: 0 done, 1 internal error, 2 bad input, 130 interrupted.
"""

import argparse
import json
import sys
import time
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from scenes.catalog.entries import CATALOG, CLASSICS
from scenes.files.errors import InputError
from scenes.files.installed import packages_needed
from scenes.files.stopping import stop_on_signals

if TYPE_CHECKING:
    from scenes.rendering.writer import Standing


def main(arguments: list[str] | None = None) -> int:
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.command == "render" and bool(options.names) == bool(options.scene_file):
        parser.error("render: name scenes of the catalogue, or one file with --scene-file")
    try:
        runs = {"render": _render, "export": _export, "noise": _noise, "repeats": _repeats, "sheet": _sheet}
        runs[options.command](options)
    except InputError as error:
        print(f"scenes: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("scenes: interrupted; give the command again", file=sys.stderr)
        return 130
    return 0


def _render(options: argparse.Namespace) -> None:
    from scenes.catalog.mitsuba_xml import notes
    from scenes.catalog.scene_file import scene_from_file
    from scenes.modelling.scene import Scene
    from scenes.rendering.order import NoiseTarget
    from scenes.rendering.store import ensure_view_set
    from scenes.view_sets.manifest import read_manifest

    if options.threads is not None:
        import drjit

        drjit.set_thread_count(options.threads)
    counts = {"train": options.train, "val": options.val, "test": options.test}
    spp = {"train": options.spp_train, "val": options.spp_val or options.spp_train, "test": options.spp_test}
    ceilings = {"train": options.ceiling_train, "val": options.ceiling_val, "test": options.ceiling_test}
    if ceilings["val"] is None:
        ceilings["val"] = ceilings["train"]
    targets = {split: spp[split] if db is None else NoiseTarget(db, spp[split]) for split, db in ceilings.items()}
    scenes: list[str | Scene] = [*options.names]
    if options.scene_file is not None:
        scenes.append(scene_from_file(options.scene_file))
    for scene in scenes:
        started = time.perf_counter()
        event = partial(_event, scene if isinstance(scene, str) else scene.name)
        for note in [] if isinstance(scene, str) else notes(scene):
            event(note)
        path = ensure_view_set(
            scene, resolution=options.resolution, counts=counts, spp=targets, cache_folder=options.view_sets,
            variant=options.variant, progress=event, integrator=options.integrator, say=event,
        )  # fmt: skip
        seconds = round(time.perf_counter() - started, 3)
        event({"path": str(path), "variant": read_manifest(path)["variant"], "seconds": seconds})


def _event(scene: str, facts: "str | dict[str, object] | Standing") -> None:
    if isinstance(facts, str):
        facts = {"note": facts}
    print(json.dumps({"scene": scene, **(facts if isinstance(facts, dict) else asdict(facts))}), flush=True)


def _export(options: argparse.Namespace) -> None:
    from scenes.view_sets.formats.export import export

    for note in export(options.folder, options.format, options.out):
        print(note)
    print(options.out)


def _noise(options: argparse.Namespace) -> None:
    from scenes.rendering.noise_study import rerender
    from scenes.rendering.variant import choose_variant

    variant = choose_variant(options.variant)
    for folder in options.folders:
        for row in rerender(folder, options.repeats, variant):
            print(json.dumps({"item": str(folder), **asdict(row)}), flush=True)


def _repeats(options: argparse.Namespace) -> None:
    import numpy as np

    from scenes.rendering.checks import repeated

    try:
        options.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{options.out}: cannot be written ({error.strerror}); name another folder") from error
    for name in options.names:
        renders = repeated(
            name, options.view, options.resolution, options.spp, options.stream, options.count, options.variant
        )
        path = options.out / f"{name}.npy"
        np.save(path, np.stack([image.astype(np.float32) for image in renders]))
        print(json.dumps({"scene": name, "path": str(path)}), flush=True)


def _sheet(options: argparse.Namespace) -> None:
    from scenes.files.atomic import require_suffix
    from scenes.rendering.checks import write_sheet

    require_suffix(options.out, ".png", "sheet")
    write_sheet(options.out, options.names or CLASSICS, options.resolution, options.spp, options.variant)
    print(options.out)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m scenes", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    render = commands.add_parser("render", help="render view sets into a cache folder")
    render.add_argument("names", nargs="*", metavar="NAME", help=f"known: {' '.join(CATALOG)}")
    render.add_argument("--scene-file", type=Path, metavar="FILE", help="your scene, .xml or .py; it can run code")
    render.add_argument("--resolution", type=int, default=100, metavar="PX")
    for split, count, spp in (("train", 100, 64), ("val", 0, None), ("test", 25, 256)):
        render.add_argument(f"--{split}", type=int, default=count, metavar="N", help=f"{split} views")
        render.add_argument(f"--spp-{split}", type=int, default=spp, metavar="N", help="samples per pixel")
        ceiling = "PSNR of the noise; takes the samples that this needs, at most --spp"
        render.add_argument(f"--ceiling-{split}", type=float, metavar="DB", help=ceiling)
    render.add_argument("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR")
    render.add_argument("--integrator", choices=("path", "volpath"), help="default: what the scene needs")
    render.add_argument("--threads", type=int, metavar="N", help="threads of the renderer (default: one per core)")
    export = commands.add_parser("export", help="write a view set in the format of another trainer")
    export.add_argument("folder", type=Path, metavar="VIEW_SET", help="a folder or file that --view-set takes")
    export.add_argument("--format", required=True, choices=("nerfstudio", "blender", "npz"))
    export.add_argument("--out", type=Path, required=True, metavar="PATH", help="new folder, or new .npz file")
    noise = commands.add_parser("noise", help="the noise of stored test views, from new renders, as JSON lines")
    noise.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="rendered view sets")
    noise.add_argument("--repeats", type=int, default=2, metavar="N", help="new renders of each view")
    repeats = commands.add_parser("repeats", help="render one view repeatedly with independent noise, as OUT/NAME.npy")
    repeats.add_argument("out", type=Path, metavar="OUT", help="folder to write to")
    repeats.add_argument("names", nargs="+", metavar="NAME")
    repeats.add_argument("--view", type=int, default=0, metavar="N", help="number of the test view, 0 to 199")
    repeats.add_argument("--resolution", type=int, default=48, metavar="PX")
    repeats.add_argument("--spp", type=int, default=256, metavar="N", help="samples per pixel of each render")
    repeats.add_argument("--stream", default="", metavar="TEXT", help="random stream; different names are independent")
    repeats.add_argument("--count", type=int, default=16, metavar="N", help="renders")
    sheet = commands.add_parser("sheet", help="render a labelled contact sheet")
    sheet.add_argument("out", type=Path, metavar="OUT.png")
    sheet.add_argument("names", nargs="*", metavar="NAME", help="default: the eight classics")
    sheet.add_argument("--resolution", type=int, default=400, metavar="PX")
    sheet.add_argument("--spp", type=int, default=256, metavar="N")
    for command in (render, noise, repeats, sheet):
        command.add_argument("--variant", help="Mitsuba variant (default: the fastest that works)")
    return parser


if __name__ == "__main__":
    stop_on_signals()
    with packages_needed():
        sys.exit(main())
