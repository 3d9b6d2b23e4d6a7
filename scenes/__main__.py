"""`python -m scenes render NAME… | sheet OUT.png`: renders in a process of its own, which Dr.Jit may take down.

`render` prints one JSON object a line: `{"scene", "done", "total"}` for each view, then
`{"scene", "path", "variant", "seconds"}`. Exit codes: 0 done, 1 our own error, 2 bad input.
"""

import argparse
import json
import sys
import time
from pathlib import Path

from scenes.catalog import CATALOG
from scenes.errors import InputError


def main(arguments: list[str] | None = None) -> int:
    options = _parser().parse_args(arguments)
    try:
        if options.command == "render":
            _render(options)
        else:
            from scenes.sheet import write_sheet

            write_sheet(options.out, options.names or None, options.resolution, options.spp, options.variant)
            print(options.out)
    except InputError as error:
        print(f"scenes: {error}", file=sys.stderr)
        return 2
    return 0


def _render(options: argparse.Namespace) -> None:
    from scenes.manifest import read_manifest
    from scenes.store import ensure_view_set

    counts = {"train": options.train, "val": options.val, "test": options.test}
    spp = {"train": options.spp_train, "val": options.spp_val or options.spp_train, "test": options.spp_test}
    for name in options.names:
        started = time.perf_counter()

        def say(done: int, total: int, name: str = name) -> None:
            print(json.dumps({"scene": name, "done": done, "total": total}), flush=True)

        path = ensure_view_set(
            name, resolution=options.resolution, counts=counts, spp=spp,
            cache_folder=options.view_sets, variant=options.variant, progress=say,
        )  # fmt: skip
        seconds = round(time.perf_counter() - started, 3)
        variant = read_manifest(path)["variant"]
        print(json.dumps({"scene": name, "path": str(path), "variant": variant, "seconds": seconds}), flush=True)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m scenes", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    render = commands.add_parser("render", help="render view sets into a cache folder")
    render.add_argument("names", nargs="+", metavar="NAME", help=f"known: {' '.join(CATALOG)}")
    render.add_argument("--resolution", type=int, default=100, metavar="PX")
    for split, count, spp in (("train", 100, 64), ("val", 0, None), ("test", 25, 256)):
        render.add_argument(f"--{split}", type=int, default=count, metavar="N", help=f"{split} views")
        render.add_argument(f"--spp-{split}", type=int, default=spp, metavar="N", help="samples a pixel")
    render.add_argument("--view-sets", type=Path, default=Path("out/view_sets"), metavar="DIR")
    sheet = commands.add_parser("sheet", help="render a labelled contact sheet")
    sheet.add_argument("out", type=Path, metavar="OUT.png")
    sheet.add_argument("names", nargs="*", metavar="NAME", help="default: the eight classics")
    sheet.add_argument("--resolution", type=int, default=400, metavar="PX")
    sheet.add_argument("--spp", type=int, default=256, metavar="N")
    for command in (render, sheet):
        command.add_argument("--variant", help="Mitsuba variant (default: the fastest that works)")
    return parser


if __name__ == "__main__":
    sys.exit(main())
