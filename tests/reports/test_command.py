"""python -m reports: exit codes, messages, and imports."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from harness.records.json_record import load_record, write_record
from harness.records.study import SHELVES
from reports.__main__ import BAD_INPUT, OWN_ERROR, SOME_FAILED, STOPPED, main, parser
from tests.reports.fake_run import fake_records, write_fake_run
from tests.reports.fake_studies import SETTINGS, write_fake_studies

ROOT = Path(__file__).parents[2]


def test_a_whole_run_gives_0_and_quiet_prints_the_path_alone(whole, tmp_path, capsys):
    out = shutil.copytree(whole.out, tmp_path / "run")
    assert main([str(out), "--quiet"]) == 0
    assert capsys.readouterr().out == f"{out / 'report.html'}\n"
    assert (out / "summary.json").is_file()


def test_the_help_lists_every_exit_code():
    codes = re.findall(r"(?<= )\d+(?= )", parser().epilog)
    assert [int(code) for code in codes] == [0, OWN_ERROR, BAD_INPUT, SOME_FAILED, STOPPED]


def test_diverged_cells_give_3_and_are_named_and_the_path_comes_last(out, capsys):
    assert main([str(out)]) == 3
    title, lost, path = capsys.readouterr().out.splitlines()
    assert "qnerf" in title
    assert lost.startswith("drums, qnerf, seed 2: diverged (not finite at step 412")
    assert path == str(out / "report.html")
    assert Path(path).is_file()


def test_bad_input_gives_2_and_one_line(tmp_path, out, capsys):
    def refused(folder, said):
        assert main([str(folder)]) == 2
        caught = capsys.readouterr()
        assert caught.out == ""
        assert said in caught.err
        assert len(caught.err.splitlines()) == 1

    refused(tmp_path, ", ".join(["no records/", *(f"no {file}" for file in SHELVES.values())]))
    run = load_record(out / "records" / "run.json")
    run["claims"][0]["claims"] = [{"id": "table2-chair"}]
    write_record(out / "records" / "run.json", {name: value for name, value in run.items() if name != "digest"})
    refused(out, "$.claims")
    assert not (out / "report.html").exists()


def test_a_folder_that_cannot_be_written_gives_2(out, capsys, monkeypatch):
    def read_only(*_):
        raise PermissionError(13, "Permission denied", str(out / "summary.json"))

    monkeypatch.setattr("reports.run.saving.publish.write_json", read_only)
    assert main([str(out)]) == 2
    assert capsys.readouterr().err == (
        f"{out / 'summary.json'}: Permission denied; make room or choose a folder that can be written\n"
    )


def test_publish_writes_small_plots_and_the_numbers(tmp_path, pictured, capsys):
    main([str(pictured), "--quiet", "--publish", str(tmp_path / "docs")])
    sizes = {path.name: path.stat().st_size for path in (tmp_path / "docs").iterdir()}
    assert set(sizes) == {"psnr.png", "error_vs_time.png", "work_precision.png", "views.png", "summary.json"}
    assert all(1000 < size < 1_000_000 for size in sizes.values())
    assert (tmp_path / "docs" / "psnr.png").read_bytes().startswith(b"\x89PNG")


def fresh(code: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-W", "error", "-c", code, *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)


LIGHT = {"scenes", "scenes.files"} | {
    f"scenes.files.{name}" for name in ("errors", "atomic", "installed", "json_object", "standard_output", "stopping")
}
HEAVY = (
    f"print(sorted(name for name in set(sys.modules) - {LIGHT!r} "
    "if name.split('.')[0] in ('torch', 'mitsuba', 'drjit', 'baselines', 'scenes')))"
)


def test_pages_are_built_without_torch_and_mitsuba_and_with_colour_science_for_pictures_alone(tmp_path):
    bare = fake_records(tmp_path / "bare", scenes=("chair",), seeds=1).out
    out = write_fake_run(tmp_path / "run", ("chair",), seeds=1, with_diverged=False)
    for shelf in SETTINGS:
        write_fake_studies(out, shelf)
    build = "import sys; from reports.__main__ import main; main(sys.argv[1:2]); print('colour' in sys.modules)"
    done = fresh(f"{build}; main(sys.argv[2:]); {HEAVY}", str(bare), str(out), "--publish", str(tmp_path / "docs"))
    assert done.stderr == ""
    assert "False" in done.stdout.splitlines()
    assert done.stdout.splitlines()[-1] == "[]"


def test_the_check_of_imports_can_fail():
    done = fresh(f"import sys; sys.modules['torch'] = sys; {HEAVY}")
    assert done.stdout.strip() == "['torch']"


def test_ctrl_c_gives_130_and_one_line(out, capsys, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("reports.__main__.build", stopped)
    assert main([str(out)]) == 130
    said = "interrupted: every page that was written is complete; run the command again\n"
    assert capsys.readouterr().err == said
