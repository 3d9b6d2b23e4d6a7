"""How soon the viewer shows a view that nobody has looked at: coarse, and whole, methods side by side."""

from harness.serving.cache_study import cells_of
from harness.serving.situation import Situation
from harness.serving_record import FirstFrame
from harness.viewer.engine import first_frame


def measured(situation: Situation) -> FirstFrame | None:
    """The slowest of some calls, each of another pose with an empty cache. None where nothing can be rendered here."""
    cells = cells_of(situation)
    if not cells:
        return None
    calls = situation.sizes.first_frames
    cameras = [situation.camera(cells[0], pose) for pose in situation.orbit(cells[0].scene, calls)]
    found = [first_frame(cells, camera) for camera in cameras]
    return FirstFrame(
        scene=cells[0].scene.name,
        methods=[cell.learner.method for cell in cells],
        width=cameras[0].width,
        height=cameras[0].height,
        seconds_coarse=max(coarse for coarse, _ in found),
        seconds_whole=max(whole for _, whole in found),
        calls=len(found),
    )
