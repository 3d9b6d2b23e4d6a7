"""The MP4 of a film: what is asked of ffmpeg, and by a real ffmpeg where there is one."""

import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from harness.viewer.film.video import ffmpeg, write_video
from scenes.view_sets.images import write_png


def frames(folder: Path) -> Path:
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
    folder = frames(tmp_path / "100 % of it")
    fails = program(tmp_path / "ffmpeg", 'echo "Unknown encoder libx264" >&2; echo half > "${15}"; exit 8')
    line = write_video(fails, tmp_path / "a.mp4", folder, 20)
    assert "could not write it (Unknown encoder libx264)" in line
    assert {file.name for file in tmp_path.iterdir()} == {"ffmpeg", folder.name}
    assert "could not write it" in write_video(str(tmp_path / "none"), tmp_path / "a.mp4", folder, 20)


@pytest.mark.skipif(ffmpeg() is None, reason="no ffmpeg here")
def test_a_real_one_writes_all_frames_with_even_sides(tmp_path: Path) -> None:
    line = write_video(str(ffmpeg()), tmp_path / "a.mp4", frames(tmp_path / "100 % of it"), 20)
    assert "kB, H.264" in line
    said = subprocess.run([str(ffmpeg()), "-i", tmp_path / "a.mp4", "-f", "null", "-"], capture_output=True, text=True)
    assert "34x26" in said.stderr
    assert "frame=    4" in said.stderr
