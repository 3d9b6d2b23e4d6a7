"""Frames as files: the display picture, premultiplied linear light, the list of complete frames, and the MP4."""

import json
import os
import subprocess
import weakref
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageSequence

from harness.training.scoring.evaluate import View
from harness.viewer.film.frames import LISTING, FrameFolder, exr_channels
from harness.viewer.film.panels import write_animation
from harness.viewer.film.video import ffmpeg, write_video
from scenes.view_sets.images import write_png
from scenes.view_sets.pixels import display_from_linear, over_white


def view(seed: int = 0, height: int = 5, width: int = 7) -> View:
    """Return random colours over white, with transparent, nearly transparent and opaque pixels."""
    generator = np.random.default_rng(seed)
    opacity = generator.uniform(size=(height, width))
    opacity[0] = [0.0, 1.0, 1e-9, 1e-4, 0.5, 1.0, 0.0]
    straight = generator.uniform(size=(height, width, 3))
    colour = straight * opacity[..., None] + (1.0 - opacity[..., None])
    depth = generator.uniform(2.0, 6.0, size=(height, width))
    return View(*(values.astype(np.float32) for values in (colour, opacity, depth)))


def test_an_exr_over_white_is_the_picture() -> None:
    shown = view()
    channels = exr_channels(shown)
    assert list(channels) == ["R", "G", "B", "A", "Z"]
    assert {values.dtype for values in channels.values()} == {np.dtype(np.float32)}
    rgba = np.stack([channels[name] for name in "RGBA"], axis=-1)
    np.testing.assert_allclose(over_white(display_from_linear(rgba)), shown.colour, atol=2e-6)
    np.testing.assert_array_equal(channels["A"], shown.opacity)
    np.testing.assert_array_equal(channels["Z"], shown.depth)


def test_linear_light_is_premultiplied() -> None:
    """Half covered by display grey 0.5: linear 0.21404 (IEC 61966-2-1), of which half."""
    half, full = np.full((1, 1), 0.5, np.float32), np.ones((1, 1), np.float32)
    grey = View(np.full((1, 1, 3), 0.75, np.float32), half, full)
    assert exr_channels(grey)["G"].item() == pytest.approx(0.5 * 0.2140411, rel=1e-6)
    solid = View(np.full((1, 1, 3), 0.5, np.float32), full, full)
    assert exr_channels(solid)["R"].item() == pytest.approx(0.2140411, rel=1e-6)


def test_what_covers_nothing_has_no_colour_and_rounding_makes_none() -> None:
    channels = exr_channels(view())
    nothing = channels["A"] == 0.0
    assert nothing.sum() == 2
    for name in "RGB":
        assert (channels[name][nothing] == 0.0).all()
        assert (channels[name] >= 0.0).all()
        assert (channels[name] <= channels["A"]).all(), "no brighter than white of the same coverage"
    over = View(*(np.array(values, np.float32) for values in ([[[1.0001, -1e-4, 0.5]]], [[1.00001]], [[3.0]])))
    assert [exr_channels(over)[name].item() for name in "RGA"] == [1.0, 0.0, 1.0]


def test_an_animation_holds_few_of_its_frames_at_a_time(tmp_path: Path) -> None:
    made: list[weakref.ref[np.ndarray]] = []

    def pictures() -> Iterator[np.ndarray]:
        for level in range(9):
            assert sum(picture() is not None for picture in made) <= 2
            picture = np.full((4, 6, 3), 20 * level, dtype=np.uint8)
            made.append(weakref.ref(picture))
            yield picture

    write_animation(tmp_path / "a.webp", pictures(), 9, 10)
    with Image.open(tmp_path / "a.webp") as film:
        levels = [frame.convert("RGB").getpixel((3, 2)) for frame in ImageSequence.Iterator(film)]
    assert levels == [(20 * level,) * 3 for level in range(9)]


SPOILT: dict[str, Callable[[Path], object]] = {
    "no PNG": lambda folder: (folder / "0001.png").unlink(),
    "no EXR": lambda folder: (folder / "0001.exr").unlink(),
    "a PNG cut off": lambda folder: (folder / "0001.png").write_bytes((folder / "0001.png").read_bytes()[:-1]),
    "an empty EXR": lambda folder: (folder / "0001.exr").write_bytes(b""),
    "another EXR": lambda folder: (folder / "0001.exr").write_bytes((folder / "0000.exr").read_bytes()),
    "no list": lambda folder: (folder / LISTING).unlink(),
    "no JSON": lambda folder: (folder / LISTING).write_text("{"),
    "another list": lambda folder: (folder / LISTING).write_text("[1]"),
    "not of frames": lambda folder: (folder / LISTING).write_text(json.dumps({"0001": 3})),
}


@pytest.mark.parametrize("wrong", SPOILT)
def test_an_incomplete_frame_is_noticed(wrong: str, tmp_path: Path) -> None:
    folder = FrameFolder(tmp_path)
    folder.write(0, "first", view(0))
    folder.write(1, "second", view(1))
    assert folder.is_whole(1, "second")
    again = FrameFolder(tmp_path)
    assert [again.is_whole(0, "first"), again.is_whole(1, "second")] == [True, True]
    assert not again.is_whole(1, "first"), "another view"
    assert not again.is_whole(2, "third")
    SPOILT[wrong](tmp_path)
    assert not FrameFolder(tmp_path).is_whole(1, "second")


# as a video, by a real ffmpeg where there is one


def numbered(folder: Path) -> Path:
    folder.mkdir()
    for number in range(4):
        write_png(folder / f"{number:04}.png", np.full((25, 33, 3), 0.2 * number, dtype=np.float32))
    return folder


def program(file: Path, text: str) -> str:
    file.write_text(f"#!/bin/sh\n{text}\n")
    file.chmod(0o755)
    return str(file)


@pytest.mark.skipif(os.name != "posix", reason="a script in the place of ffmpeg needs a shell")
def test_a_program_that_fails_leaves_no_file_and_is_named(tmp_path: Path) -> None:
    folder = numbered(tmp_path / "100 % of it")
    fails = program(tmp_path / "ffmpeg", 'echo "Unknown encoder libx264" >&2; echo half > "${15}"; exit 8')
    line = write_video(fails, tmp_path / "a.mp4", folder, 20)
    assert "could not write it (Unknown encoder libx264)" in line
    assert {file.name for file in tmp_path.iterdir()} == {"ffmpeg", folder.name}
    assert "could not write it" in write_video(str(tmp_path / "none"), tmp_path / "a.mp4", folder, 20)


@pytest.mark.skipif(ffmpeg() is None, reason="no ffmpeg here")
def test_a_real_one_writes_all_frames_with_even_sides(tmp_path: Path) -> None:
    line = write_video(str(ffmpeg()), tmp_path / "a.mp4", numbered(tmp_path / "100 % of it"), 20)
    assert "kB, H.264" in line
    said = subprocess.run([str(ffmpeg()), "-i", tmp_path / "a.mp4", "-f", "null", "-"], capture_output=True, text=True)
    assert "34x26" in said.stderr
    assert "frame=    4" in said.stderr
