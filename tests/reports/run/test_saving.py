"""What is saved besides the page: summary.json, everything in a zip, and the command that trains a cell again."""

import csv
import io
import json
import math
import re
import shlex
import zipfile
from pathlib import Path

import numpy as np
import pytest

from harness.command.main import main
from harness.records.cells import CellRecord, cell_path, read_cell
from reports.data.load import Records, read_records
from reports.run.run_page import page
from reports.run.saving.citation import bibtex, records_digest
from reports.run.saving.export import write_export
from reports.run.saving.publish import summary, write_summary
from reports.run.saving.replay import conditions, replay
from tests.harness.ball import write_ball
from tests.harness.trained_runs import in_this_process
from tests.replacing import replace
from tests.reports.fake_run import fake_records

CELL = {
    "scene", "method", "seed", "status", "reason", "steps", "train_seconds", "train_core_seconds", "psnr", "ssim",
    "flip", "delta_e", "rmse_linear", "depth_rmse", "opacity_iou", "psnr_train", "psnr_ceiling", "curve",
}  # fmt: skip
COMPARISON = {
    "scene", "method", "against", "metric", "budget", "difference", "interval", "verdict", "smallest_detectable",
}  # fmt: skip


def written(records: Records, folder: Path) -> dict:
    write_summary(records, folder / "summary.json")
    text = (folder / "summary.json").read_text(encoding="utf-8")
    return json.loads(text, parse_constant=lambda word: pytest.fail(f"{word} in JSON"))


def test_the_summary_has_what_scripts_rely_on(records: Records, tmp_path: Path) -> None:
    data = written(records, tmp_path)
    assert {"schema", "profile", "provenance", "cells", "comparisons", "claims", "left_out"} <= set(data)
    assert set(data["cells"][0]) >= CELL
    assert set(data["cells"][0]["curve"]) >= {"steps", "seconds", "core_seconds", "psnr", "rmse_linear"}
    assert set(data["comparisons"][0]) >= COMPARISON
    assert set(data["claims"][0]) >= {"id", "source", "printed", "measured", "interval", "scale", "verdict", "kind"}
    assert set(data["left_out"][0]) >= {"scene", "what", "seconds_saved", "difference", "interval"}


def test_numbers_are_those_of_the_records(records: Records) -> None:
    data = summary(records)
    first = data["cells"][0]
    assert (first["scene"], first["method"], first["seed"], first["status"]) == ("chair", "nerf", 0, "done")
    assert first["psnr"] == records.cells[0].scores["psnr"]
    assert first["curve"]["steps"] == [50, 100, 200, 400, 800, 1600]
    assert first["curve"]["core_seconds"] == [point.core_seconds for point in records.cells[0].curve]
    gains = {row["method"]: row["gain"] for row in data["last_doubling"]}
    # at half of the steps, a fake run has 4/5 of the logarithm of its steps: 3.2 dB × 0.2^1.4
    assert gains == pytest.approx(dict.fromkeys(records.methods, 3.2 * 0.2**1.4), abs=1e-3)
    lost = data["cells"][-1]
    assert (lost["status"], lost["reason"]) == ("diverged", "not finite at step 412: density_head.weight")
    assert (lost["psnr"], lost["curve"]["steps"]) == (None, [50, 100, 200, 400])
    assert data["failures"]["rates"][2]["diverged"] == 1
    row = next(row for row in data["comparisons"] if row["scene"] == "all")
    assert row["on_these_scenes"]["interval"] != row["scenes_like_these"]["interval"]


def test_a_number_that_is_not_finite_becomes_null(records: Records, tmp_path: Path) -> None:
    wild = replace(records.cells[0], scores={"psnr": math.inf, "ssim": math.nan})
    first = written(replace(records, cells=[wild, *records.cells[1:]]), tmp_path)["cells"][0]
    assert (first["psnr"], first["ssim"]) == (None, None)


@pytest.fixture(scope="module")
def brief(tmp_path_factory: pytest.TempPathFactory) -> Records:
    options = {"scenes": ("lego", "ship"), "seeds": 1, "with_diverged": True}
    return fake_records(tmp_path_factory.mktemp("brief"), **options)


@pytest.fixture(scope="module")
def shown(brief: Records) -> str:
    return page(brief)


@pytest.fixture(scope="module")
def zipped(brief: Records) -> zipfile.ZipFile:
    write_export(brief, brief.out / "all.zip")
    return zipfile.ZipFile(brief.out / "all.zip")


@pytest.mark.slow
def test_every_table_of_the_page_is_in_the_zip(shown: str, zipped: zipfile.ZipFile) -> None:
    def plain(caption: str) -> str:
        return re.sub(r"[^a-z0-9]+", "-", caption.lower()).strip("-")

    captions = re.findall(r"<caption[^>]*>([^<]*)</caption>", shown)
    own = {plain(caption) for caption in captions if "Claimed and measured" not in caption}
    ruler = "What is to be expected of scenes like these? Difference in mean test PSNR, 95 % interval, sign and size"
    own -= {plain(ruler), plain("At what scale")}
    files = {Path(name).stem for name in zipped.namelist() if name.startswith("tables/")}
    assert own <= {re.sub(r"-\d+$", "", name) for name in files} | files


def test_every_drawing_is_there_in_three_formats(shown: str, zipped: zipfile.ZipFile) -> None:
    drawn = [Path(name) for name in zipped.namelist() if name.startswith("figures/")]
    stems = {path.stem for path in drawn}
    assert len(drawn) == 3 * len(stems)
    assert shown.count("<figure>") <= len(stems)
    starts = {".pdf": b"%PDF", ".png": b"\x89PNG", ".svg": b"<?xml"}
    assert all(zipped.read(str(path)).startswith(starts[path.suffix]) for path in drawn)


def test_a_csv_holds_the_exact_numbers(brief: Records, zipped: zipfile.ZipFile) -> None:
    rows = list(csv.DictReader(io.StringIO(zipped.read("tables/test-psnr.csv").decode())))
    (cell,) = brief.cells_of("lego", "nerf")
    lego = next(row for row in rows if row["scene"] == "lego")
    assert float(lego["nerf"]) == pytest.approx(cell.scores["psnr"], rel=1e-12)
    assert "\\toprule" in zipped.read("tables/test-psnr.tex").decode()


@pytest.mark.slow
def test_the_same_run_gives_the_same_tables_and_drawings(brief: Records, zipped: zipfile.ZipFile) -> None:
    with np.printoptions(legacy="1.13"):  # as colour-science sets it when it is imported
        write_export(read_records(brief.out), brief.out / "again.zip")
    again = zipfile.ZipFile(brief.out / "again.zip")
    assert again.namelist() == zipped.namelist()
    for name in zipped.namelist():
        if not name.endswith(".svg"):  # Matplotlib draws random ids
            assert again.read(name) == zipped.read(name), name


def test_a_citation_names_the_records_and_no_others(brief: Records, zipped: zipfile.ZipFile) -> None:
    text = bibtex(brief)
    assert zipped.read("citation.bib").decode() == text
    assert f"@misc{{radiance-verdict-{records_digest(brief)[:12]}," in text
    assert text.count("{") == text.count("}")
    assert not re.search(r"(?<!\\)[%&#$_]", text)
    assert records_digest(brief) == records_digest(read_records(brief.out))
    changed = replace(brief, cells=[replace(brief.cells[0], steps=1), *brief.cells[1:]])
    assert records_digest(changed) != records_digest(brief)


def made(records: Records, command: str, **changes: object) -> str:
    cell = replace(records.cells[-1], **changes)
    return replay(replace(records, run=replace(records.run, command=command)), cell)


def test_it_names_the_cell_and_keeps_what_the_cell_depends_on(records: Records) -> None:
    origin = {"threads": 2, "device": "NVIDIA H100", "commit": "0123", "packages": {"torch": "2.0", "scipy": "1"}}
    command = made(
        records,
        "python -m harness run --profile smoke --no-serving --resume --out 'a b' --resolution 32 --without grid hull",
        provenance=origin,
        settings={"train": {"precision": "bfloat16"}},
    )
    assert command == (
        "python -m harness run --profile smoke --resolution 32 --without grid hull --scenes drums --methods qnerf "
        "--seeds 1 --first-seed 2 --device cuda --threads 2 --precision bfloat16"
    )
    assert conditions(replace(records.cells[-1], provenance=origin)) == "commit 0123, torch 2.0"


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("--view-set my/chair 'my/drums' --bounds -1 -1 -1 1 1 1", "--view-set my/drums --bounds -1 -1 -1 1 1 1"),
        ("--scene-file my.xml", "--scene-file my.xml"),
        ("--scene-file=my.xml", "--scene-file=my.xml"),
    ],
)
def test_the_cells_own_view_set_or_scene_file_is_kept(records: Records, given: str, kept: str) -> None:
    start = f"python -m harness run {kept} --methods qnerf --seeds 1"
    assert made(records, f"python -m harness run {given}").startswith(start)


def test_studies_and_guests_have_no_command(records: Records) -> None:
    assert made(records, "nox -s evidence") == ""
    guests = replace(records.run, guests=["qnerf"])
    assert replay(replace(records, run=guests), records.cells[-1]) == ""


@pytest.mark.slow
def test_its_training_has_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.execution.run.run_locally", in_this_process)
    first, view_set = tmp_path / "first", tmp_path / "ball"
    write_ball(view_set)
    options = ["--profile", "smoke", "--view-set", str(view_set), "--budget-steps", "3", "--seeds", "2"]
    options += ["--methods", "nerf", "qnerf", "--resolution", "16"]
    assert main(["run", *options, "--quiet", "--out", str(first)]) == 0
    records = read_records(first)
    (cell,) = [cell for cell in records.cells if (cell.method, cell.seed) == ("qnerf", 1)]
    words = shlex.split(replay(records, cell))
    again = tmp_path / "again"
    assert main([*words[3:], "--quiet", "--out", str(again)]) == 0
    assert [path.name for path in (again / "records/cells").glob("*.json")] == [f"{cell.scene}.qnerf.1.json"]

    def bits(made: CellRecord) -> tuple[object, ...]:
        weights = {name: digest for name, digest in made.files.items() if "checkpoint" in name or "weights" in name}
        return made.scores, made.trace["loss"], weights

    assert bits(read_cell(cell_path(again, cell.scene, "qnerf", 1))) == bits(cell)
    assert bits(cell)[2]
