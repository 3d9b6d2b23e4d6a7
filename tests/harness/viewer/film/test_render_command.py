"""`python -m harness render`, end to end on a small run; a mistake is one line, and finished frames are kept."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from harness.command.main import main
from harness.execution import progress
from harness.playback.camera_paths import orbit
from harness.playback.run_loader import FinishedRun
from harness.run_folder.folder_lock import lock_folder
from harness.training.scoring.evaluate import View, render_view
from harness.viewer.film import film_making, frames
from harness.viewer.film.frames import as_levels, exr_channels
from harness.viewer.film.panels import HEADER, MARGIN, size_of
from scenes.view_sets.images import read_channels, read_image
from scenes.view_sets.pixels import over_white
from scenes.view_sets.view_set import read_view_set
from tests.harness.ball import DISTANCE
from tests.harness.patching import preceded
from tests.harness.shell import refused
from tests.harness.tiny import CPU
from tests.harness.trained_runs import SIZE, train_run

Said = Callable[..., str]
"""Render with the given options, on one thread; returns the printed lines."""


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not to be changed; its view set `ball` lies next to it. `out`, of the folder above, is a copy."""
    return train_run(tmp_path_factory.mktemp("film"), ["nerf", "nerf_matched", "qnerf"], steps=14)


@pytest.fixture
def render(capsys: pytest.CaptureFixture[str]) -> Said:
    def rendered(*arguments: str | Path) -> str:
        capsys.readouterr()
        assert main(["render", *map(str, arguments), "--threads", "1"]) == 0
        said, complaints = capsys.readouterr()
        assert complaints == ""
        return said

    return rendered


def contents(folder: Path) -> dict[str, object]:
    """Return the bytes of every file; of an EXR, which holds the time of day, only its pixels."""
    files: dict[str, object] = {}
    for file in folder.rglob("*"):
        if file.suffix == ".exr":
            channels = read_channels(file)
            files[str(file.relative_to(folder))] = {name: values.tobytes() for name, values in channels.items()}
        elif file.name == "frames.json":
            frames = json.loads(file.read_text(encoding="utf-8"))
            files[str(file.relative_to(folder))] = {name: (one["key"], one[".png"]) for name, one in frames.items()}
        elif file.is_file():
            files[str(file.relative_to(folder))] = file.read_bytes()
    return files


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The method of each frame that is rendered into a film."""
    names: list[str] = []
    preceded(monkeypatch, film_making, "render_frame", lambda cell, camera: names.append(cell.cell.method))
    return names


def plainly(out: Path, method: str, poses: np.ndarray, width: int = SIZE) -> list[View]:
    run = FinishedRun.of(out)
    cell = run.trained(run.run.scenes[0], method, 0, CPU)
    cameras = [cell.camera(pose).resized(width).cameras(CPU) for pose in poses]
    return [render_view(cell.learner, camera, 0, cell.chunk) for camera in cameras]


@pytest.mark.slow
def test_an_orbit_of_three_frames(out: Path, render: Said) -> None:
    printed = render(out, "--frames", "3", "--fps", "10")
    folder = out / "films" / "orbit-3-frames"
    frames = {f"000{number}.{kind}" for number in range(3) for kind in ("png", "exr")} | {"frames.json"}
    for method in ("nerf", "qnerf"):
        assert {file.name for file in (folder / "ball" / method).iterdir()} == frames
        views = plainly(out, method, orbit(3, DISTANCE))
        assert not np.array_equal(views[0].colour, views[1].colour)
        for number, view in enumerate(views):
            stem = folder / "ball" / method / f"000{number}"
            png = read_image(stem.with_suffix(".png"))
            assert np.abs(png.astype(float) - np.clip(view.colour, 0, 1)).max() <= 0.5 / 255 + 1e-7
            stored = read_channels(stem.with_suffix(".exr"))
            for name, values in exr_channels(view).items():
                np.testing.assert_array_equal(stored[name], values)
    assert {file.name for file in folder.iterdir()} == {"film.json", "ball"}
    written = {file.name for file in (folder / "ball").iterdir()} - {"orbit.mp4"}
    assert written == {"nerf", "qnerf", "side_by_side", "orbit.webp"}
    sheets = [read_image(folder / "ball" / "side_by_side" / f"000{number}.png") for number in range(3)]
    width, height = size_of(2, SIZE, SIZE)
    assert {sheet.shape for sheet in sheets} == {(height, width, 3)}
    with Image.open(folder / "ball" / "orbit.webp") as animation:
        assert (animation.size, animation.n_frames, animation.info["loop"]) == ((width, height), 3, 0)
        for number, sheet in enumerate(sheets):
            animation.seek(number)
            animation.load()
            assert animation.info["duration"] == 100
            np.testing.assert_array_equal(np.asarray(animation.convert("RGB")), as_levels(sheet))
    for one in ("3 frames of 16 × 16", "6: 0 there, 0 in the view cache, 6 to render", "estimated cost", "hit rate 0%"):
        assert one in printed


def test_panels_are_the_methods_and_on_the_test_path_the_truth(out: Path, render: Said) -> None:
    render(out, "--path", "test", "--methods", "qnerf", "nerf_matched")
    folder = out / "films" / "test" / "ball"
    truth = read_view_set(FinishedRun.of(out).view_set(FinishedRun.of(out).run.scenes[0]))
    side = 13 * SIZE
    for number in range(3):
        sheet = as_levels(read_image(folder / "side_by_side" / f"000{number}.png"))
        assert sheet.shape[1] == size_of(3, SIZE, SIZE)[0]
        panels = [sheet[HEADER : HEADER + side : 13, MARGIN + k * (side + MARGIN) :][:, :side:13] for k in range(3)]
        pngs = [as_levels(read_image(folder / name / f"000{number}.png")) for name in ("qnerf", "nerf_matched")]
        for panel, expected in zip(panels, [*pngs, as_levels(over_white(truth.test.rgba[number]))], strict=True):
            np.testing.assert_array_equal(panel, expected)
    view = plainly(out, "qnerf", truth.test.camera_to_world[1:2])[0]
    np.testing.assert_array_equal(as_levels(read_image(folder / "qnerf" / "0001.png")), as_levels(view.colour))


def test_a_second_run_is_from_the_cache_and_bit_for_bit_the_same(out: Path, render: Said, counted: list[str]) -> None:
    first, second, third = (out / name for name in ("first", "second", "third"))
    render(out, "--frames", "3", "--to", first)
    assert counted == ["nerf"] * 3 + ["qnerf"] * 3
    printed = render(out, "--frames", "3", "--to", second)
    assert len(counted) == 6, "nothing was rendered"
    assert "6: 0 there, 6 in the view cache, 0 to render" in printed
    assert printed.count("3 from the view cache") == printed.count("hit rate 100%") == 2
    assert contents(first) == contents(second)
    printed = render(out, "--frames", "3", "--to", third, "--no-cache")
    assert len(counted) == 12
    assert "from the view cache" not in printed
    assert "hit rate" not in printed
    assert contents(first) == contents(third)


def test_only_missing_or_damaged_frames_are_made_again(
    out: Path, render: Said, counted: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    progressed: list[tuple[int, int]] = []
    monkeypatch.setattr(progress.Lines, "part", lambda _, what, done, total: progressed.append((done, total)))
    ask = (out, "--frames", "3", "--no-cache", "--path", "spiral")
    render(*ask)
    folder = out / "films" / "spiral-3-frames"
    before, times = contents(folder), {file: file.stat().st_mtime_ns for file in folder.rglob("000*.exr")}
    counted.clear()
    progressed.clear()
    assert "6: 6 there" in render(*ask)
    assert counted == []
    assert progressed == []
    (folder / "ball" / "nerf" / "0001.exr").unlink()
    damaged = folder / "ball" / "qnerf" / "0002.png"
    damaged.write_bytes(damaged.read_bytes()[:-20])
    assert "6: 4 there" in render(*ask)
    assert counted == ["nerf", "qnerf"]
    assert progressed == [(1, 2), (2, 2)], "existing frames are not progress"
    assert contents(folder) == before
    changed = {file.name for file, time in times.items() if file.stat().st_mtime_ns != time}
    assert changed == {"0001.exr", "0002.exr"}
    assert "3 there already" in render(*ask, "--methods", "nerf_matched", "nerf"), "others may join"


@pytest.mark.parametrize("damage", ["[]", '{"path": "orbit"', None])
def test_frames_of_a_film_without_record_stay(out: Path, render: Said, counted: list[str], damage: str | None) -> None:
    ask = ("--frames", "2", "--methods", "nerf", "--no-cache")
    render(out, *ask)
    record = out / "films" / "orbit-2-frames" / "film.json"
    before = record.read_bytes()
    record.unlink() if damage is None else record.write_text(damage)
    counted.clear()
    printed = render(out, *ask)
    assert f"{record}: " in printed
    assert "written again" in printed
    assert counted == [], "frames know what they show"
    assert record.read_bytes() == before


def test_an_interrupted_film_keeps_its_frames_and_is_resumed(
    out: Path, render: Said, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    calls: list[object] = []

    def stop(cell: object, camera: object) -> None:
        calls.append(camera)
        if len(calls) == 3:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        preceded(patch, film_making, "render_frame", stop)
        assert main(["render", str(out), "--frames", "3", "--no-cache", "--threads", "1"]) == 130
    assert "finished frames are kept" in capsys.readouterr().err
    folder = out / "films" / "orbit-3-frames" / "ball"
    assert {file.name for file in (folder / "nerf").glob("*.png")} == {"0000.png", "0001.png"}
    assert "6: 2 there, 0 in the view cache, 4 to render" in render(out, "--frames", "3", "--no-cache")
    assert (folder / "orbit.webp").exists()


def test_a_dry_run_says_what_it_would_do_and_does_nothing(out: Path, render: Said) -> None:
    before = contents(out)
    printed = render(out, "--dry-run", "--frames", "4")
    assert "8: 0 there, 0 in the view cache, 8 to render" in printed
    assert contents(out) == before
    assert not (out / "films").exists()


# mistakes


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--scenes lego", "--scenes: unknown 'lego'; known: ball"),
        ("--methods nerf merf", "--methods: unknown 'merf'; known: nerf nerf_matched qnerf"),
        ("--seed -1", "--seed -1"),
        ("--frames 0", "--frames 0: must lie between 1 and 10000"),
        ("--resolution 0", "--resolution 0: must lie between 1 and 4096"),
        ("--resolution 4096 --methods nerf nerf_matched qnerf --path test", "enlarging adds nothing"),
        ("--fps 0", "--fps 0"),
        ("--threads 0", "--threads 0"),
        ("--elevation 91", "--elevation 91"),
        ("--elevation 10 --path spiral", "--elevation 10.0: only with --path orbit"),
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
    checkpoint = out / "checkpoints" / "ball.qnerf.0.safetensors"
    checkpoint.write_bytes(checkpoint.read_bytes()[:50])
    assert "ball.qnerf.0.safetensors: has fewer bytes" in refused(capsys, out, "--no-cache", command="render")
    checkpoint.unlink()
    assert "this checkpoint is missing" in refused(capsys, out, "--no-cache", command="render")
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
    def full(file: Path, channels: dict[str, np.ndarray]) -> None:
        if ".0001." in file.name:
            raise OSError(28, "No space left on device", str(file))

    ask = (out, "--frames", "2", "--methods", "nerf", "--no-cache")
    with monkeypatch.context() as patch:
        preceded(patch, frames, "write_channels", full)
        message = refused(capsys, *ask, "--quiet", "--threads", "1", command="render")
    assert "No space left on device; repair that and give the same command again" in message
    assert not list((out / "films").rglob("*.part*"))
    assert "2: 1 there" in render(*ask)
