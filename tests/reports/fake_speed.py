"""A made-up speed run: every question, targets met and missed, figures that could not be measured."""

from pathlib import Path
from typing import Any

from msgspec.structs import replace

from harness.records.study import (
    SHELVES,
    Check,
    Series,
    Studies,
    StudyInfo,
    StudyRecord,
    Table,
    check,
    write_studies,
)  # fmt: skip
from harness.studies.speed.questions import QUESTIONS

PROVENANCE: dict[str, Any] = {
    "commit": "0123456789ab",
    "python": "3.11.2",
    "processor": "AMD EPYC 9R14",
    "cores": 2,
    "threads": 2,
    "device": "cpu",
    "bfloat16_products": True,
    "packages": {"torch": "2.15.0"},
}

SCENES = {"chair": (812.0, 41.0, 5.4), "lego": (1310.0, 75.2, 9.1), "ship": (None, 160.0, 22.0)}


def fake_speed(**changes: Any) -> Studies:
    """Every question that something is said about; `seconds` by question."""
    seconds = {"1": 61.2, "3": 2412.0}
    items = sorted({item for item, _ in measurements()} | {one.item for one in [*series(), *tables()]})
    studies = [
        StudyRecord(
            QUESTIONS[str(item)].info,
            findings=[
                *(one for of, one in measurements() if of == item),
                *(one for one in [*series(), *tables()] if one.item == item),
            ],
            seconds=seconds.get(str(item), 0.0),
        )
        for item in items
    ]
    settings = {"quick": False, "repeats": 5, "rays": 1024}
    parts: dict[str, Any] = {
        "shelf": "speed",
        "provenance": PROVENANCE,
        "settings": settings,
        "studies": studies,
        "finished": True,
    }
    return Studies(**{**parts, **changes})


def tables() -> list[Table]:
    rows: list[list[str | float | None]] = [
        ["products", 210.4, 71.2, "bfloat16"],
        ["encoding", 31.07, 10.5, None],
        ["optimiser", 9, None, "Adam"],
    ]
    return [Table("profile.step", 2, "Where the time of one step goes", ["part", "ms", "share (%)", "note"], rows)]


def of_question(
    id: str, item: int, title: str, value: float | None, unit: str, low: float | None = None, high: float | None = None,
    repeats: int = 1, target: float | None = None, sense: str = "at_least", detail: str = "",
) -> tuple[int, Check]:  # fmt: skip
    spread = None if low is None or high is None else (low, high)
    ends = (target, None) if sense == "at_least" else (None, target)
    return item, check(title, value, *ends, unit, detail, owner="machine", spread=spread, repeats=repeats, id=id)


def measurements() -> list[tuple[int, Check]]:
    plain = "Dense step, plain float32"
    found = [
        of_question("training.plain.rate", 1, plain, 30_120.0, "samples/s", 29_870.0, 30_410.0, 5),
        of_question(
            "training.dense.ratio",
            1,
            "Same step against plain",
            7.418,
            "×",
            7.11,
            7.63,
            5,
            target=10.0,
            detail="same 1024 rays, 64 samples, 8 × 256, L = 10/4, medians of the same round",
        ),
        of_question("matrix.share", 2, "Share in the steady state", 66.1, "%", 63.9, 67.0, 5, target=65.0),
        of_question("encoding.phi.ratio", 5, "φ recurrence against direct sin/cos", 3.9, "×", 3.7, 4.0, 9, target=3.0),
        of_question(
            "truth.llvm",
            7,
            "llvm_ad_rgb against scalar_rgb",
            None,
            "×",
            target=2.0,
            detail="no shared library of LLVM 16 or newer",
        ),
        of_question("memory.reduced", 8, "Peak at `reduced`", 1.42, "GB", target=2.0, sense="at_most"),
        of_question("memory.images", 8, "Growth with 4 × the images", 0.31, "GB", target=0.1, sense="at_most"),
        of_question("processes.gain", 10, "Two processes against one", 1.31, "×", 1.28, 1.33, 3),
    ]
    for scene, (slow, same, reduced) in SCENES.items():
        found += [
            of_question(f"target.{scene}.plain", 3, f"{scene}: plain", slow, "s", detail="" if slow else "never there"),
            of_question(f"target.{scene}.same_network", 3, f"{scene}: same network", same, "s", same * 0.9, same, 3),
            of_question(f"target.{scene}.reduced", 3, f"{scene}: reduced settings", reduced, "s"),
            of_question(
                f"target.{scene}.same.ratio",
                3,
                f"{scene}: same network, sooner by",
                slow / same if slow else None,
                "×",
                target=15.0,
                detail="" if slow else "plain never reached 22 dB within its 1800 s",
            ),
        ]
    return found


def series() -> list[Series]:
    ways = {"plain": 1.0, "same network": 0.1, "reduced settings": 0.01}
    found = [
        Series(
            f"PSNR against training seconds, {scene}",
            3,
            way,
            "training seconds",
            "PSNR of test pixels (dB)",
            [scale * x for x in (10, 30, 100, 300, 1000)],
            [15, 18.1, 20.2, 22.0, 23.4],
            log_y=False,
        )
        for scene in ("chair", "lego")
        for way, scale in ways.items()
    ]
    rays = [256.0, 512.0, 1024.0, 2048.0, 4096.0]
    seconds = [0.02, 0.036, 0.07, 0.138, 0.27]
    low, high = [0.9 * one for one in seconds], [1.15 * one for one in seconds]
    return [
        *found,
        Series("Rays a step", 9, "this code", "rays a step", "seconds a step", rays, seconds, low, high),
        Series("Rays a step", 9, "plain", "rays a step", "seconds a step", [1024.0], [2.2], [2.1], [2.4]),
        Series("Image side", 9, "this code", "pixels", "seconds a frame", [100.0, 200.0], [0.3, 1.1]),
        Series("Nothing", 9, "empty", "x", "y", [], []),
    ]


def write_fake_speed(folder: Path, **changes: Any) -> Path:
    """`folder` with a speed.json in it."""
    folder.mkdir(parents=True, exist_ok=True)
    write_studies(folder / SHELVES["speed"], fake_speed(**changes))
    return folder


def hostile(record: Studies, word: str) -> Studies:
    """`record` with `word` wherever it holds text of its own."""

    def spoiled(one: StudyRecord) -> StudyRecord:
        findings = [
            *(replace(found, what=word, why=word, unit=word, id=word) for found in one.checks),
            *(replace(s, panel=word, name=f"{word} {s.name}", x_label=word, y_label=word) for s in one.series),
            *(
                replace(t, title=word, columns=[word for _ in t.columns], rows=[[word for _ in row] for row in t.rows])
                for t in one.tables
            ),
        ]
        return StudyRecord(StudyInfo(f"{word} {one.info.id}", word), findings=findings, seconds=1.0)

    named = {word: word, "processor": word, "device": word}
    studies = [spoiled(one) for one in record.studies]
    return replace(record, provenance=named, settings={word: [word]}, studies=studies)
