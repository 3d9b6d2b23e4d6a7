"""`python -m harness run`: a mistake is reported in one line, before anything is done; `splats` is typed."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from harness.command.main import main, parsed
from harness.command.plan_options import planned
from harness.execution.progress import Progress
from harness.execution.run import run
from harness.plan.run_plan import Machine
from harness.records.cells import cell_path, read_cell, read_cells, read_comparisons
from harness.records.scored_pictures import read_scores
from harness.records.verdict import OPEN
from harness.run_folder.output_folder import claim
from tests.harness.bad_view_sets import SPOILT
from tests.harness.shell import CELLS, TINY, refused, shell
from tests.harness.trained_runs import in_this_process, train_run

# bad input


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ("--profile tiny", "--profile: unknown 'tiny'; known: smoke reduced stress ladder converged full"),
        ("--scenes lego teapot", "unknown 'teapot'; known: "),
        ("--methods nerf gnerf", "unknown 'gnerf'; known: nerf nerf_matched qnerf"),
        ("--methods nerf nerf", "named twice"),
        ("--seeds 0", "--seeds 0: must lie between"),
        ("--budget-steps 0", "--budget-steps 0"),
        ("--budget-seconds nan", "--budget-seconds nan"),
        ("--resolution 100000", "--resolution 100000"),
        ("--workers 0", "--workers 0"),
        ("--scenes lego --view-set x", "exclude each other"),
        ("--dry-run --view-set nowhere", "--view-set nowhere: no such folder; a view set is a folder with transforms_"),
        ("--dry-run --view-set .", "--view-set .: not a view set; a view set is a folder with transforms_train.json"),
        ("--executor ray --ray-address 192.0.2.9:1 --scenes teapot", "unknown 'teapot'"),
    ],
)
def test_bad_options_are_reported_in_one_line(
    options: str, said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert said in refused(capsys, "--quiet", *options.split())
    assert list(tmp_path.iterdir()) == []


def test_what_a_view_set_lists_is_read_in_a_dry_run(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "transforms.json").write_text('{"camera_angle_x": 0.6, "frames": []}')
    assert f"--view-set {tmp_path}/transforms.json" in refused(capsys, "--dry-run", "--view-set", tmp_path)


@pytest.mark.parametrize(
    ("options", "when"),
    [
        ("run --render-limit 5.0", "with --scene-file"),
        ("run --ray-address 192.0.2.9:1", "with --executor ray"),
        ("run --job timeout_min=5", "with --executor submitit"),
        ("run --near 0.5", "with --view-set"),
        ("study constants --best 2 --out c.json", "with --carry"),
        ("study frontier --seconds 8.0", "with --pick"),
        ("study frontier --resume --pick lego", "without --pick"),
        ("study frontier --long --quick", "without --quick"),
        ("study speed --history x.json --quick", "without --quick"),
        ("gate --history x.json --renew", "without --renew"),
        ("doctor --out x.json", "with --device"),
        ("doctor --json --device cpu", "without --device"),
    ],
)
def test_an_option_that_would_mean_nothing_is_refused(
    options: str, when: str, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(options.split()) == 2
    words = options.split(" --")[1]
    assert capsys.readouterr().err == f"error: --{words}: only {when}; otherwise leave it out\n"
    assert list(tmp_path.iterdir()) == []


NO_OPTIONS = ("lego", "--colour red", "--seeds many", "--device tpu", "--executor cloud", "--with x")


@pytest.mark.parametrize("arguments", ["", "walk", *(f"run {words}" for words in NO_OPTIONS)])
def test_bad_usage_is_exit_code_2(arguments: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments.split())
    assert caught.value.code == 2
    assert "error: " in capsys.readouterr().err


@pytest.mark.parametrize("number", ["-1e0", "-1.5E+2", "-.5e-3", "-1"])
def test_a_negative_number_is_none_of_the_options(number: str) -> None:
    bounds = parsed(["run", "--bounds", number, "0", "0", "1", "1", "1"]).bounds
    assert bounds == [float(number), 0.0, 0.0, 1.0, 1.0, 1.0]
    assert parsed(["history", "--out", number]).out == Path(number), "a folder keeps its name"


@pytest.mark.parametrize("wrong", SPOILT)
def test_a_bad_view_set_is_reported_before_anything_is_done(
    wrong: str, ball_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, expected = SPOILT[wrong]
    folder = tmp_path / "ball"
    shutil.copytree(ball_folder, folder)
    spoil(folder)
    said = refused(capsys, *TINY, "--quiet", "--view-set", folder, "--out", tmp_path / "run")
    assert expected in said
    assert str(folder) in said
    assert [file.name for file in tmp_path.iterdir()] == ["ball"], "the same command can be typed again"


def test_a_too_small_view_set_is_refused(ball_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    said = refused(capsys, *TINY, "--quiet", "--view-set", ball_folder, "--out", tmp_path / "run", "--resolution", "48")
    assert "choose --resolution 24 or less" in said
    assert list(tmp_path.iterdir()) == []


def test_from_a_shell_there_is_no_traceback(tmp_path: Path) -> None:
    ran = shell("--profile", "smoke", "--view-set", tmp_path / "nowhere", "--out", tmp_path / "run")
    assert ran.returncode == 2
    assert ran.stderr.count("\n") == 1
    assert "Traceback" not in ran.stderr + ran.stdout


def test_an_output_folder_that_cannot_be_is_refused(
    ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    (tmp_path / "out" / "earlier").mkdir(parents=True)
    (tmp_path / "out" / "latest").symlink_to("earlier")
    monkeypatch.chdir(tmp_path)
    for out, expected in (
        (file, "is a file"),
        (file / "run", "cannot be written"),
        (Path("/proc/run"), "cannot be written"),
        (tmp_path / ("long" * 100), "cannot be written"),
        (tmp_path, "in use by something else"),
    ):
        assert expected in refused(capsys, *TINY, "--quiet", "--view-set", ball_folder, "--out", out)
    assert file.read_text() == "mine"
    assert (tmp_path / "out" / "latest").readlink() == Path("earlier")


# other surfaces


def test_without_out_a_quiet_run_gets_a_fresh_folder_which_latest_names(
    ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("harness.execution.run.run", lambda *_: 0)
    assert main(["run", *TINY, "--quiet", "--view-set", str(ball_folder)]) == 0
    (folder,) = (tmp_path / "out").glob("smoke-*")
    assert (tmp_path / "out" / "latest").resolve() == folder
    assert capsys.readouterr() == ("", "")


def test_a_diverged_cell_is_exit_code_3_and_stays_visible(
    ball_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.execution.run.run_locally", in_this_process)
    plan = planned("smoke", view_set=[ball_folder], methods=["nerf", "qnerf"], seeds=2, budget_steps=20, resolution=24)
    plan = replace(plan, train=replace(plan.train, learning_rate=1e30, last_learning_rate=1e30, warm_up_steps=0))
    claim(tmp_path / "run", plan, Machine("cpu", 1, 1), resume=False)
    assert run(plan, tmp_path / "run", tmp_path, Machine("cpu", 1, 1), "none", Progress()) == 3
    cells = list(read_cells(tmp_path / "run"))
    assert [(cell.method, cell.seed) for cell in cells] == CELLS
    diverged = [cell for cell in cells if cell.status == "diverged"]
    assert diverged
    for cell in diverged:
        assert (cell.reason or "").startswith(f"not finite at step {cell.steps}: ")
    assert {row.verdict for row in read_comparisons(tmp_path / "run")} == {OPEN}
    assert sum(row.unpaired for row in read_comparisons(tmp_path / "run") if row.metric == "psnr") > 0


# `python -m harness splats`


@pytest.mark.slow
def test_gaussians_of_a_run_are_written_and_score_as_in_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
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
    given = ("--view-set", tmp_path / "ball", "--dry-run", "--splats", tmp_path / "none.ply")
    assert "none.ply: cannot be read" in refused(capsys, *given)
    assert "give a .ply for each of the scenes, in this order: ball" in refused(capsys, *given, tmp_path / "none.ply")
