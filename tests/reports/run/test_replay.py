"""The command that trains a cell again: its words, and its result."""

import shlex
from pathlib import Path

import pytest

from harness.command.main import main
from harness.records.cells import CellRecord, cell_path, read_cell
from reports.data.load import Records, read_records
from reports.run.saving.replay import conditions, replay
from tests.harness.ball import write_ball
from tests.replacing import replace


def made(records: Records, command: str, **changes: object) -> str:
    cell = replace(records.cells[-1], **changes)
    return replay(replace(records, run=replace(records.run, command=command)), cell)


def test_it_names_the_cell_and_keeps_what_the_cell_depends_on(records: Records) -> None:
    origin = {"threads": 2, "device": "NVIDIA H100", "commit": "0123", "packages": {"torch": "2.0", "scipy": "1"}}
    command = made(
        records,
        "python -m harness run --profile smoke --no-serving --resume --out 'a b' --resolution 32 --without grid fused",
        provenance=origin,
        settings={"train": {"precision": "bfloat16"}},
    )
    assert command == (
        "python -m harness run --profile smoke --resolution 32 --without grid fused --scenes drums --methods qnerf "
        "--seeds 1 --first-seed 2 --device cuda --threads 2 --precision bfloat16"
    )
    assert conditions(replace(records.cells[-1], provenance=origin)) == "commit 0123, torch 2.0"


def test_of_several_view_sets_only_that_of_the_cell_is_kept(records: Records) -> None:
    command = "python -m harness run --view-set my/chair 'my/drums' --bounds -1 -1 -1 1 1 1"
    kept = made(records, command).split(" --methods")[0]
    assert kept == "python -m harness run --view-set my/drums --bounds -1 -1 -1 1 1 1"


def test_a_scene_file_is_kept_in_place_of_a_name(records: Records) -> None:
    for given in ("--scene-file my.xml", "--scene-file=my.xml"):
        command = f"python -m harness run {given}"
        assert made(records, command).startswith(f"{command} --methods qnerf --seeds 1")


def test_studies_and_guests_have_no_command(records: Records) -> None:
    assert made(records, "nox -s evidence") == ""
    guests = replace(records.run, guests=["qnerf"])
    assert replay(replace(records, run=guests), records.cells[-1]) == ""


@pytest.mark.slow
def test_its_training_has_the_same_bits(tmp_path: Path) -> None:
    first, view_set = tmp_path / "first", tmp_path / "ball"
    write_ball(view_set)
    options = ["--profile", "smoke", "--view-set", str(view_set), "--budget-steps", "12", "--seeds", "2"]
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
