"""`python -m harness judge TABLE`, `score PICTURES` and `compare A B`."""

import argparse
import sys
import time
from pathlib import Path

from harness.command.options import Command, Options, flag, option, reported, require_between, require_folder
from harness.execution.progress import Progress
from scenes.files.atomic import require_suffix
from scenes.files.errors import InputError

JUDGE: Options = {
    "tables": option(
        "CSV, Markdown, LaTeX, Parquet (extra parquet) or JSON: a row per result or a column per scene; results of "
        "nerfbaselines, 3D Gaussian Splatting, ns-eval or gsplat, or a folder of them; summary.json of a run",
        "TABLE",
        Path,
        nargs="+",
    ),
    "--metric": option(
        "metrics to judge, each by itself (default: psnr, else the first one)", "NAME", nargs="+", default=[]
    ),
    "--methods": option("methods to judge together (default: all of the table)", "NAME", nargs="+", default=[]),
    "--lower": option("metrics that are better when lower", "NAME", nargs="+", default=[]),
    "--margin": option("smallest effect of interest (default: 0.2 dB of psnr, …)", "SIZE", float),
    "--baseline": option("compare each method only with this one (default: all pairs)", "METHOD"),
    "--out": option("output folder (default: a fresh out/judge-TIME)"),
}
SCORING = (
    "Scores of pictures that another program rendered of a view set's test views (3D Gaussian Splatting, nerfstudio, "
    "instant-ngp, nerfbaselines, or any folder with a picture of each view), or of Gaussians in a .ply file, which are "
    "drawn here, as a table for `judge`."
)
SCORE: Options = {
    "pictures": option("folder of the pictures, or one that contains it; or a .ply of Gaussians", "PICTURES", Path),
    "--view-set": option("view set with the ground truth of the pictures", "DIR", Path, required=True),
    "--method": option("name of the method in the table", "NAME", required=True),
    "--scene": option("name of the scene in the table (default: that of the view set)", "NAME"),
    "--seed": option("seed of the training, for the table (default: 0)"),
    "--seconds": option("training seconds, for the table", "S", float),
    "--resolution": option(
        "width at which both are compared (default: that of the pictures; of a .ply: that of the view set)"
    ),
    "--lpips": {},
    "--as-they-are": flag("score pictures that seem to be in another order or colour space"),
    "--to": option(
        "table to which the row is added (default: out/scores.json)", "FILE", Path, default=Path("out/scores.json")
    ),
}
COMPARING = (
    "How far two outputs of the same plan differ: scores cell by cell, verdicts, headline. Run the plan on two "
    "machines, or on one with ATEN_CPU_CAPABILITY=avx2 in the environment of the second run, which makes torch leave "
    "out AVX-512 (ONEDNN_MAX_CPU_ISA=AVX2 does so for matrix multiplications); cells record their instruction set."
)
COMPARE: Options = {
    "first": option("output folder of a run", "A", Path),
    "second": option("output folder of the same run, made again", "B", Path),
    "--json": option("write everything that is printed, as JSON", "FILE", Path),
}


def run_judge(options: argparse.Namespace, show: Progress) -> int:
    from harness.records.judgements import JUDGEMENT_FILE, write_judgement
    from harness.verdicts.judging.judgement import judge_files, lines
    from harness.verdicts.judging.printed import write_tables

    record = judge_files(
        options.tables, options.metric, options.lower, options.margin, options.baseline, options.methods
    )
    out = options.out or Path("out") / f"judge-{time.strftime('%Y%m%d-%H%M%S')}"
    require_folder(out)
    write_judgement(out / JUDGEMENT_FILE, record)
    write_tables(out, record)
    for line in lines(record):
        show.line(line)
    return reported(out)


def run_score(options: argparse.Namespace, show: Progress) -> int:
    from msgspec.structs import replace

    from harness.records.metric_table import METRICS
    from harness.records.scored_pictures import read_scores, write_scores
    from harness.training.scoring.others import SCORED, score_pictures

    require_between(options, seed=(0, 2**31), seconds=(0.0, 1e9), resolution=(1, 4096))
    for name in ("method", "scene"):
        if getattr(options, name) is not None and not getattr(options, name).strip():
            raise InputError(f"--{name} {getattr(options, name)!r}: is empty; give a name")
    table = read_scores(options.to)
    row = score_pictures(
        options.pictures,
        options.view_set,
        options.method,
        resolution=options.resolution,
        as_they_are=options.as_they_are,
        lpips=options.lpips,
        each=lambda done, total: show.part("scoring views", done, total),
    )
    row = replace(row, scene=options.scene or row.scene, seed=options.seed, seconds=options.seconds)
    write_scores(options.to, table, row)
    known = [METRICS[name] for name in SCORED if getattr(row, name) is not None]
    scores = ", ".join(f"{metric.label} {getattr(row, metric.name):.{metric.digits}f}" for metric in known)
    views = f"{len(row.views)} views of {row.made['width']} px"
    network = f" ({row.made['lpips_network']})" if row.lpips is not None else ""
    show.line(f"{row.scene} {row.method} seed {row.seed}, {views}: {scores}{network}")
    worst = min(row.views, key=lambda view: view.psnr or 0.0)
    show.line(f"worst view {worst.view}: {worst.psnr:.2f} dB; table {options.to} ({len(table.cells)} rows before)")
    return 0


def run_compare(options: argparse.Namespace, show: Progress) -> int:
    from harness.records.json_record import write_json
    from harness.verdicts.judging.two_runs import as_json, lines_of, two_runs

    if options.json is not None:
        require_suffix(options.json, ".json", "--json")
    runs = two_runs(options.first, options.second)
    sys.stdout.write("\n".join(lines_of(runs)) + "\n")
    if options.json is not None:
        write_json(options.json, as_json(runs))
    return 0


COMMANDS = {
    "judge": Command("give verdicts on any table of results", JUDGE, run_judge),
    "score": Command("score pictures that another program rendered", SCORE, run_score, SCORING),
    "compare": Command("show how far two outputs of the same plan differ", COMPARE, run_compare, COMPARING),
}
