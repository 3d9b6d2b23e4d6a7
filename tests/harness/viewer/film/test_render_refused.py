"""`python -m harness render`: a mistake is reported in one line, and finished frames are kept."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.run_folder.folder_lock import lock_folder
from tests.harness.shell import refused
from tests.harness.viewer.film.typed import Said, contents


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--scenes lego", "--scenes: unknown 'lego'; known: ball"),
        ("--methods nerf merf", "--methods: unknown 'merf'; known: nerf nerf_matched qnerf"),
        ("--methods nerf nerf", "named twice"),
        ("--seed 7", "seed 7 was not trained"),
        ("--seed -1", "--seed -1"),
        ("--frames 0", "--frames 0: must lie between 1 and 10000"),
        ("--resolution 0", "--resolution 0: must lie between 1 and 4096"),
        ("--resolution 4096 --methods nerf nerf_matched qnerf --path test", "enlarging adds nothing"),
        ("--fps 0", "--fps 0"),
        ("--threads 0", "--threads 0"),
        ("--elevation 91", "--elevation 91"),
        ("--elevation 10 --path spiral", "--elevation: --path spiral"),
        ("--path test --frames 4", "4 test views were asked for; choose 0 to 3"),
    ],
)
def test_bad_options_are_reported_in_one_line(
    options: str, message: str, trained: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(trained)
    assert message in refused(capsys, trained, *options.split(), "--no-cache", command="render")
    assert contents(trained) == before


def test_a_missing_or_incomplete_run_is_refused(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "holds no run" in refused(capsys, out / "nowhere", command="render")
    assert "holds no run" in refused(capsys, out / "checkpoints", command="render")
    checkpoint = out / "checkpoints" / "ball.qnerf.0.safetensors"
    checkpoint.write_bytes(checkpoint.read_bytes()[:50])
    assert "ball.qnerf.0.safetensors: has fewer bytes" in refused(capsys, out, "--no-cache", command="render")
    checkpoint.unlink()
    assert "this checkpoint is missing" in refused(capsys, out, "--no-cache", command="render")
    (out / "records" / "run.json").write_text("{")
    assert "run.json" in refused(capsys, out, "--no-cache", command="render")
    assert not (out / "films").exists()


def test_a_folder_in_use_or_of_another_film_is_refused(
    out: Path, tmp_path: Path, render: Said, capsys: pytest.CaptureFixture[str]
) -> None:
    mine, file = tmp_path / "mine", tmp_path / "file"
    mine.mkdir()
    (mine / "letter.txt").write_text("mine")
    file.write_text("mine")
    ask = (out, "--frames", "2", "--methods", "nerf", "--to")
    assert "in use by something else" in refused(capsys, *ask, mine, command="render")
    assert "is a file" in refused(capsys, *ask, file, command="render")
    assert "cannot be written" in refused(capsys, *ask, file / "film", command="render")
    assert "cannot be written" in refused(capsys, *ask, Path("/proc/film"), command="render")
    render(*ask, tmp_path / "film")
    message = refused(capsys, out, "--frames", "3", "--methods", "nerf", "--to", tmp_path / "film", command="render")
    assert "holds another film (frames was 2, is 3)" in message
    lock = lock_folder(tmp_path / "film")
    message = refused(capsys, *ask, tmp_path / "film", command="render")
    assert message.startswith(f"error: --to {tmp_path / 'film'}: in use by process ")
    lock.release(remove=True)
    assert contents(mine) == {"letter.txt": b"mine"}


def test_a_film_that_was_killed_at_its_beginning_is_resumed(out: Path, tmp_path: Path, render: Said) -> None:
    film = tmp_path / "film"
    (film / "damaged").mkdir(parents=True)
    (film / "damaged" / "film.json.1").write_text("{")
    (film / ".film.json.1234.part").write_text("{")
    ask = (out, "--frames", "2", "--methods", "nerf", "--no-cache", "--to", film)
    assert "2 rendered" in render(*ask)
    assert {file.name for file in film.iterdir()} == {"damaged", "film.json", "ball"}
    (film / "ball" / "nerf" / ".0001.exr.1234.part.exr").write_text("half")
    assert "2: 2 there" in render(*ask)
    assert not list(film.rglob(".*.part*"))


def test_a_full_disk_is_reported_and_finished_frames_are_kept(
    out: Path, render: Said, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from harness.viewer.film import frames

    def full(file: Path, channels: dict[str, np.ndarray], write: Callable[..., None] = frames.write_channels) -> None:
        if ".0001." in file.name:
            raise OSError(28, "No space left on device", str(file))
        write(file, channels)

    ask = (out, "--frames", "2", "--methods", "nerf", "--no-cache")
    with monkeypatch.context() as patch:
        patch.setattr(frames, "write_channels", full)
        message = refused(capsys, *ask, "--quiet", "--threads", "1", command="render")
    assert "No space left on device; repair that and give the same command again" in message
    assert not list((out / "films").rglob("*.part*"))
    assert "2: 1 there" in render(*ask)
