"""A made-up speed run: every question, targets met and missed, figures that could not be measured."""

from pathlib import Path
from typing import Any

from harness.records.study import Check, Series, Studies, StudyRecord, Table, check
from harness.studies.speed.questions import QUESTIONS
from tests.reports.fake_shelf import PROVENANCE, lines, shelf, write_shelf

MACHINE = {"processor": "AMD EPYC 9R14", "threads": 2, "device": "cpu", "bfloat16_products": True}
SCENES = {"chair": (812.0, 41.0, 5.4), "lego": (1310.0, 75.2, 9.1), "ship": (None, 160.0, 22.0)}


def fake_speed(**changes: Any) -> Studies:
    """Every question that something is said about."""
    seconds = {1: 61.2, 3: 2412.0}
    drawn = [*series(), table()]
    of_question = measurements()
    studies = [
        StudyRecord(
            QUESTIONS[str(item)].info,
            findings=[*of_question.get(item, []), *(finding for finding in drawn if finding.item == item)],
            seconds=seconds.get(item, 0.0),
        )
        for item in sorted({*of_question, *(finding.item for finding in drawn)})
    ]
    settings = {"quick": False, "repeats": 5, "rays": 1024}
    return shelf("speed", studies, settings, {"provenance": PROVENANCE | MACHINE, **changes})


def table() -> Table:
    rows: list[list[str | float | None]] = [
        ["products", 210.4, 71.2, "bfloat16"],
        ["encoding", 31.07, 10.5, None],
        ["optimiser", 9, None, "Adam"],
    ]
    return Table("profile.step", 2, "Where the time of one step goes", ["part", "ms", "share (%)", "note"], rows)


def figure(id: str, title: str, value: float | None, unit: str, spread: Any = None, repeats: int = 1, low: Any = None,
           high: Any = None, detail: str = "") -> Check:  # fmt: skip
    return check(title, value, low, high, unit, detail, owner="machine", spread=spread, repeats=repeats, id=id)


def measurements() -> dict[int, list[Check]]:
    plain, ratio = (
        "Dense step, plain float32",
        "same 1024 rays, 64 samples, 8 × 256, L = 10/4, medians of the same round",
    )
    recurrence, library = "φ recurrence against direct sin/cos", "no shared library of LLVM 16 or newer"
    targets = []
    for scene, (slow, same, reduced) in SCENES.items():
        sooner = slow / same if slow else None
        ratio_of, late = f"{scene}: same network, sooner by", "" if slow else "plain never reached 22 dB within 1800 s"
        targets += [
            figure(f"target.{scene}.plain", f"{scene}: plain", slow, "s", detail="" if slow else "never there"),
            figure(f"target.{scene}.same_network", f"{scene}: same network", same, "s", (same * 0.9, same), 3),
            figure(f"target.{scene}.reduced", f"{scene}: reduced settings", reduced, "s"),
            figure(f"target.{scene}.same.ratio", ratio_of, sooner, "×", low=15.0, detail=late),
        ]
    return {
        1: [
            figure("training.plain.rate", plain, 30_120.0, "samples/s", (29_870.0, 30_410.0), 5),
            figure("training.dense.ratio", "Same step against plain", 7.418, "×", (7.11, 7.63), 5, 10.0, detail=ratio),
        ],
        2: [figure("matrix.share", "Share in the steady state", 66.1, "%", (63.9, 67.0), 5, 65.0)],
        3: targets,
        5: [figure("encoding.phi.ratio", recurrence, 3.9, "×", (3.7, 4.0), 9, 3.0)],
        7: [figure("truth.llvm", "llvm_ad_rgb against scalar_rgb", None, "×", low=2.0, detail=library)],
        8: [
            figure("memory.reduced", "Peak at `reduced`", 1.42, "GB", high=2.0),
            figure("memory.images", "Growth with 4 × the images", 0.31, "GB", high=0.1),
        ],
        10: [figure("processes.gain", "Two processes against one", 1.31, "×", (1.28, 1.33), 3)],
    }


def series() -> list[Series]:
    scores = dict(zip((10.0, 30.0, 100.0, 300.0, 1000.0), (15.0, 18.1, 20.2, 22.0, 23.4), strict=True))
    to_target = [
        Series(f"PSNR against training seconds, {scene}", 3, way, "training seconds", "PSNR of test pixels (dB)",
               [scale * x for x in scores], [*scores.values()], log_y=False)
        for scene in ("chair", "lego")
        for way, scale in {"plain": 1.0, "same network": 0.1, "reduced settings": 0.01}.items()
    ]  # fmt: skip
    seconds = {256.0: 0.02, 512.0: 0.036, 1024.0: 0.07, 2048.0: 0.138, 4096.0: 0.27}
    low, high = ([factor * value for value in seconds.values()] for factor in (0.9, 1.15))
    axes = ("rays a step", "seconds a step")
    return [
        *to_target,
        Series("Rays a step", 9, "this code", *axes, [*seconds], [*seconds.values()], low, high),
        Series("Rays a step", 9, "plain", *axes, [1024.0], [2.2], [2.1], [2.4]),
        *lines("Image side", 9, ("pixels", "seconds a frame"), [100.0, 200.0], {100.0: 0.3, 200.0: 1.1}.get,
               {"this code": ()}),
        Series("Nothing", 9, "empty", "x", "y", [], []),
    ]  # fmt: skip


def write_fake_speed(folder: Path, **changes: Any) -> Path:
    """`folder` with a speed.json in it."""
    return write_shelf(folder, fake_speed(**changes))
