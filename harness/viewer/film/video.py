"""An MP4 of an animation's frames, where ffmpeg is installed, or the wheel imageio-ffmpeg that carries it."""

import shutil
import subprocess
from contextlib import suppress
from pathlib import Path

from scenes.files.atomic import replacing

QUALITY = 14
"""The constant rate factor of H.264: at 18 and below, errors cannot be seen."""
EVEN = "pad=ceil(iw/2)*2:ceil(ih/2)*2"
"""H.264 halves the resolution of colour, so that both sides must be even."""


def ffmpeg() -> str | None:
    if program := shutil.which("ffmpeg"):
        return program
    with suppress(ImportError, RuntimeError):
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    return None


def write_video(program: str, file: Path, frames: Path, fps: int) -> str:
    """Encode FRAMES/0000.png, 0001.png, … and return a line on it; an old program may lack the encoder."""
    options = ["-framerate", str(fps), "-i", "%04d.png", "-vf", EVEN, "-c:v", "libx264", "-crf", str(QUALITY)]
    try:
        with replacing(file.absolute(), ".mp4") as temporary:
            call = [program, "-loglevel", "error", "-y", *options, "-pix_fmt", "yuv420p", str(temporary)]
            done = subprocess.run(call, cwd=frames, capture_output=True, text=True, stdin=subprocess.DEVNULL)
            if done.returncode:
                raise OSError((done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1])
    except OSError as error:
        return f"{file}: {program} could not write it ({error}); the WebP has the same frames"
    return f"{file}: {file.stat().st_size / 1e3:.0f} kB, H.264, with the errors of a codec"
