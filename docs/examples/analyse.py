"""A table and a figure of your own from a run's records: python docs/examples/analyse.py out/latest [FOLDER]"""

import argparse
import json
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import pandas as pd


def cells_of(out: Path) -> pd.DataFrame:
    """A row a cell; `scores.psnr`, `properties.occupied_share`, `provenance.commit`, … are columns."""
    return pd.json_normalize([json.loads(file.read_text()) for file in sorted(out.glob("records/cells/*.json"))])


def curves_of(out: Path) -> pd.DataFrame:
    """A row a checkpoint."""
    records = [json.loads(file.read_text()) for file in sorted(out.glob("records/cells/*.json"))]
    return pd.json_normalize(records, "curve", ["scene", "method", "seed"])


def table(cells: pd.DataFrame) -> pd.DataFrame:
    """PSNR in dB, mean over seeds, scene by method; a method that has no score in a scene is empty there."""
    return cells.pivot_table(index="scene", columns="method", values="scores.psnr", aggfunc="mean").round(2)


def figure(curves: pd.DataFrame, path: Path) -> None:
    """PSNR over training seconds, a panel a scene, a line a cell."""
    scenes = list(dict.fromkeys(curves.scene))
    methods = list(dict.fromkeys(curves.method))
    rows = -(-len(scenes) // 4)
    drawing, panels = plt.subplots(rows, 4, figsize=(14, 3 * rows), squeeze=False, layout="constrained")
    for panel in panels.flat[len(scenes) :]:
        panel.set_visible(False)
    for scene, panel in zip(scenes, panels.flat, strict=False):
        for (method, _), cell in curves[curves.scene == scene].groupby(["method", "seed"]):
            panel.plot(cell.seconds, cell.psnr, color=f"C{methods.index(method)}", label=method)
        panel.set(title=scene, xlabel="training seconds", ylabel="test PSNR, dB")
    one_each = {line.get_label(): line for panel in panels.flat for line in panel.get_lines()}
    drawing.legend(one_each.values(), one_each.keys(), loc="outside lower center", ncols=len(one_each))
    drawing.savefig(path, bbox_inches="tight")
    plt.close(drawing)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, metavar="OUT", help="output folder of a run")
    parser.add_argument("folder", type=Path, metavar="FOLDER", nargs="?", default=".", help="where curves.png goes")
    options = parser.parse_args()
    cells = cells_of(options.out)
    if cells.empty:
        raise SystemExit(f"{options.out}: holds no cell of a run")
    if "scores.psnr" not in cells:
        raise SystemExit(f"{options.out}: none of its {len(cells)} cells has a score ({', '.join(set(cells.status))})")
    without = int(cells["scores.psnr"].isna().sum())
    sys.stdout.write(f"{table(cells).to_string()}\n\n{without} of {len(cells)} cells without a score\n")
    figure(curves_of(options.out), options.folder / "curves.png")
    sys.stdout.write(f"{options.folder / 'curves.png'}\n")


if __name__ == "__main__":
    main()
