"""`python -m harness splats` as a user types it, and `score` of the file that it writes."""

from pathlib import Path

import pytest

from harness.command.main import main
from harness.records.cells import cell_path, read_cell
from harness.records.scored_pictures import read_scores
from tests.harness.shell import refused
from tests.harness.trained_runs import train_run


def test_gaussians_of_a_run_are_written_and_score_as_in_the_run(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, table = train_run(tmp_path, ["nerf", "splats"], steps=40, size=24), tmp_path / "scores.json"
    assert main(["splats", str(out)]) == 0
    file = out / "ball-splats-0.ply"
    assert f"{file}: " in capsys.readouterr().out
    scored = ["--view-set", tmp_path / "ball", "--method", "mine", "--to", table]
    assert main(["score", str(file), *map(str, scored)]) == 0
    (row,) = read_scores(table).cells
    trained = read_cell(cell_path(out, "ball", "splats", 0)).scores["psnr"]
    assert row.made["width"] == 24
    assert row.psnr == pytest.approx(trained, abs=0.7), "that program blurs a little more"
    assert "--method nerf: has no Gaussians" in refused(capsys, out, "--method", "nerf", command="splats")
    assert "--scene: unknown 'mic'" in refused(capsys, out, "--scene", "mic", command="splats")
    assert "ends in .ply" in refused(capsys, out, "--to", tmp_path / "a.txt", command="splats")
    file.write_bytes(file.read_bytes()[:-7])
    assert f"{file}: is not a PLY file" in refused(capsys, file, *scored, command="score")
    assert "none.ply: cannot be read" in refused(capsys, tmp_path / "none.ply", *scored, command="score")
