"""`python -m harness judge TABLE`, `score PICTURES` and `compare A B`: their options, and what they do."""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from harness.command.options import add_shared, reported, require_between, require_folder

if TYPE_CHECKING:
    from harness.execution.progress import Progress


def add_judge_options(command: argparse.ArgumentParser) -> None:
    add = command.add_argument
    add(
        "tables",
        type=Path,
        nargs="+",
        metavar="TABLE",
        help="CSV, Parquet (extra parquet) or JSON with columns scene, method, a metric, perhaps seed, steps, seconds; "
        "nerfbaselines' result files or a folder of them; summary.json of a run",
    )
    add("--metric", metavar="NAME", help="column to judge (default: psnr, else the first one)")
    add("--lower", nargs="+", default=[], metavar="NAME", help="metrics that are better when lower")
    add("--margin", type=float, metavar="SIZE", help="smallest effect of interest (default: 0.2 dB of psnr, …)")
    add("--baseline", metavar="METHOD", help="compare each method with this one alone (default: all pairs)")
    add_shared(command, "--out", help="output folder (default: a fresh out/judge-TIME)")


def run_judge(options: argparse.Namespace, show: "Progress") -> int:
    """Write judgement.json and judgement.html; raises `InputError` for a table that cannot be judged."""
    import time

    from harness.records.json_record import file_digest
    from harness.records.judgements import JUDGEMENT_FILE, write_judgement
    from harness.verdicts.judging.judgement import judge, lines
    from harness.verdicts.judging.result_table import read_table

    table = read_table(options.tables, options.metric, options.lower)
    digests = {str(path): file_digest(path) for path in options.tables if path.is_file()}
    record = judge(table, options.margin, options.baseline, digests)
    out = options.out or Path("out") / f"judge-{time.strftime('%Y%m%d-%H%M%S')}"
    require_folder(out)
    write_judgement(out / JUDGEMENT_FILE, record)
    for line in lines(record):
        show.line(line)
    return reported(out)


def add_score_options(command: argparse.ArgumentParser) -> None:
    command.description = (
        "Scores of pictures that another program rendered of a view set's test views (3D Gaussian Splatting, "
        "nerfstudio, instant-ngp, nerfbaselines, or any folder with a picture of each view), as a table for `judge`."
    )
    add = command.add_argument
    add("pictures", type=Path, metavar="PICTURES", help="folder of the pictures, or one that has it inside")
    add("--view-set", type=Path, required=True, metavar="DIR", help="with the truth: the images it was trained on")
    add("--method", required=True, metavar="NAME", help="name of the method in the table")
    add("--scene", metavar="NAME", help="name of the scene in the table (default: that of the view set)")
    add("--seed", type=int, default=0, metavar="N", help="of its training, for the table (default: 0)")
    add("--seconds", type=float, metavar="S", help="that its training took, for the table")
    add_shared(command, "--resolution", help="width at which both are compared (default: that of the pictures)")
    add("--lpips", type=Path, metavar="FILE", help="weights of LPIPS, to score with (docs/read-the-report.md)")
    add("--as-they-are", action="store_true", help="score pictures that seem to be in another order or colour space")
    add("--to", type=Path, default=Path("out/scores.json"), metavar="FILE", help="table that gets a row more, or anew "
        "(default: out/scores.json)")  # fmt: skip


def run_score(options: argparse.Namespace, show: "Progress") -> int:
    """Score pictures and write their row; raises `InputError` for what cannot be scored, and `DamagedRecord`."""
    from harness.records.metric_table import METRICS
    from harness.records.scored_pictures import read_scores, write_scores
    from harness.training.scoring.others import SCORED, score_pictures
    from scenes.files.errors import InputError

    require_between(options, seed=(0, 2**31), seconds=(0.0, 1e9), resolution=(1, 4096))
    for option in ("method", "scene"):
        if getattr(options, option) is not None and not getattr(options, option).strip():
            raise InputError(f"--{option} {getattr(options, option)!r}: is empty; give a name")
    table = read_scores(options.to)
    row = score_pictures(
        options.pictures,
        options.view_set,
        options.method,
        scene=options.scene,
        seed=options.seed,
        seconds=options.seconds,
        resolution=options.resolution,
        as_they_are=options.as_they_are,
        lpips=options.lpips,
        each=lambda done, total: show.part("scoring views", done, total),
    )
    write_scores(options.to, table, row)
    known = [METRICS[name] for name in SCORED if getattr(row, name) is not None]
    scores = (f"{metric.label} {getattr(row, metric.name):.{metric.digits}f}" for metric in known)
    show.line(f"{row.scene} {row.method} seed {row.seed}, {len(row.views)} views of {row.made['width']} px: "
              f"{', '.join(scores)}")  # fmt: skip
    worst = min(row.views, key=lambda view: view.psnr or 0.0)
    show.line(f"worst view {worst.view}: {worst.psnr:.2f} dB; table {options.to} ({len(table.cells)} rows before)")
    return 0


def add_compare_options(command: argparse.ArgumentParser) -> None:
    command.description = (
        "How far two outputs of the same plan differ: scores cell by cell, verdicts, headline. Made on two machines, "
        "or on one with ATEN_CPU_CAPABILITY=avx2 in the environment of the second run, which makes torch leave out "
        "AVX-512 (ONEDNN_MAX_CPU_ISA=AVX2 does so for products of matrices); the provenance of every cell says which."
    )
    command.add_argument("first", type=Path, metavar="A", help="output folder of a run")
    command.add_argument("second", type=Path, metavar="B", help="output folder of the same run, made again")
    command.add_argument("--json", type=Path, metavar="FILE", help="write everything that is printed, as JSON")


def run_compare(options: argparse.Namespace, show: "Progress") -> int:
    """Compare two outputs. Raises `InputError` for outputs of different plans, and `DamagedRecord`."""
    from harness.records.json_record import write_json
    from harness.verdicts.judging.two_runs import as_json, lines_of, two_runs

    runs = two_runs(options.first, options.second)
    sys.stdout.write("\n".join(lines_of(runs)) + "\n")
    if options.json is not None:
        write_json(options.json, as_json(runs))
    return 0
