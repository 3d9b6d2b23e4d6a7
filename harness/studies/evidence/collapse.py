"""A study of how often a training ends without a picture: diverged, empty, or worse than a copied photograph."""

from collections.abc import Iterator

from harness.records.cells import CellRecord
from harness.records.study import Table, check
from harness.studies.evidence.evidence_context import TRAININGS, EvidenceContext
from harness.studies.framework import Found, Rows
from harness.verdicts.failures import FINISHED, exact_interval, failure_of

BOXES = ("box_own", "box_1_5", "box_1_8", "box_2_4")
"""The trainings: in the scenes' own boxes, and in cubes, the first of which is usual for Blender's view sets."""
STUCK = "below the floor"
ENDS = ("diverged", "empty collapse", STUCK)


def end_of(cell: CellRecord) -> str | None:
    """Return how a finished run failed, None if it did not; the floor is the score of the nearest training view."""
    if failure := failure_of(cell):
        return failure
    psnr, floor = cell.scores.get("psnr"), cell.scores.get("psnr_floor")
    return STUCK if psnr is not None and floor is not None and psnr < floor else None


def collapse(context: EvidenceContext) -> Iterator[Found]:
    """Yield the number of trainings without a picture for each box, with its exact interval, and for each method."""
    answers, checks = [], []
    rows: Rows = []
    for name in BOXES:
        half = TRAININGS[name].half_side
        box = "the scene's own box" if half is None else f"a box of ±{half:g}"
        cells = [cell for cell in context.trained(name).cells if cell.status in FINISHED]
        lost = sum(end_of(cell) is not None for cell in cells)
        low, high = (100 * end for end in exact_interval(lost, len(cells)))
        answers.append(f"{lost} of {len(cells)} in {box} (95 % interval {low:.1f} to {high:.1f} %)")
        what = f"trainings without a picture, in {box}"
        checks.append(check(what, lost, high=0, id=f"lost.{name}", repeats=len(cells)))
        for method in dict.fromkeys(cell.method for cell in cells):
            ends = [end_of(cell) for cell in cells if cell.method == method]
            interval = exact_interval(len(ends) - ends.count(None), len(ends))
            counts = [str(ends.count(end)) for end in ENDS]
            rows.append([box, method, str(len(ends)), *counts, *(f"{100 * end:.1f} %" for end in interval)])
    yield f"Trainings that end without a picture: {'; '.join(answers)}."
    yield from checks
    columns = ["box", "method", "runs", *ENDS, "95 % from", "to"]
    yield Table("ends", 0, "How trainings ended, by method", columns, rows)
