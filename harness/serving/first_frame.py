"""How soon the viewer has something to show of a view that nobody has looked at: coarse, and whole, side by side."""

from collections.abc import Sequence

from harness.json_record import finite_or_none
from harness.metrics import psnr
from harness.serving.cache_study import cells_of
from harness.serving.situation import Situation
from harness.serving_record import FirstFrame
from harness.viewer.engine import Frame, first_frame, seconds_of


def measured(situation: Situation) -> FirstFrame | None:
    """The slowest of some calls, each of another pose with an empty cache. None where nothing can be rendered here."""
    cells = cells_of(situation)
    if not cells:
        return None
    calls = situation.sizes.first_frames
    methods = [cell.cell.method for cell in cells]
    cameras = [situation.camera(cells[0], pose) for pose in situation.orbit(cells[0].scene, calls)]
    shown = [first_frame(cells, camera) for camera in cameras]
    seconds = [seconds_of(frames, len(cells)) for frames in shown]
    return FirstFrame(
        scene=cells[0].scene.name,
        methods=methods,
        width=cameras[0].width,
        height=cameras[0].height,
        seconds_coarse=max(coarse for coarse, _ in seconds),
        seconds_whole=max(whole for _, whole in seconds),
        calls=len(shown),
        strides=[max(coarse_of(frames, method)[0] for frames in shown) for method in methods],
        psnr_coarse=[finite_or_none(min(coarse_of(frames, method)[1] for frames in shown)) for method in methods],
    )


def coarse_of(frames: Sequence[Frame], method: str) -> tuple[int, float]:
    """Stride of a method's coarse frame, and its PSNR in dB against the whole picture."""
    mine = {frame.state: frame for frame in frames if frame.method == method}
    return mine["coarse"].stride or 1, psnr(mine["coarse"].colour, mine["whole"].colour)
