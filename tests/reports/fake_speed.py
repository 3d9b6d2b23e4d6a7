"""A made-up speed run: every question, targets met and missed, figures that could not be measured."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from harness.records.charts import Series, Table
from harness.records.speed_record import Measurement, SpeedRecord, write_speed

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


def fake_speed(**changes: Any) -> SpeedRecord:
    parts: dict[str, Any] = {
        "provenance": PROVENANCE,
        "settings": {"quick": False, "repeats": 5, "rays": 1024},
        "measurements": measurements(),
        "series": series(),
        "tables": [
            Table(
                "profile.step",
                2,
                "Where the time of one step goes",
                ["part", "ms", "share (%)", "note"],
                [
                    ["products", 210.4, 71.2, "bfloat16"],
                    ["encoding", 31.07, 10.5, None],
                    ["optimiser", 9, None, "Adam"],
                ],
            )
        ],
        "seconds": {"1": 61.2, "3": 2412.0, "total": 3120.5},
    }
    return SpeedRecord(**{**parts, **changes})


def measurements() -> list[Measurement]:
    plain = "Dense step, plain float32"
    found = [
        Measurement("training.plain.rate", 1, plain, 30_120.0, "samples/s", 29_870.0, 30_410.0, 5),
        Measurement(
            "training.dense.ratio", 1, "Same step against plain", 7.418, "×", 7.11, 7.63, 5, target=10.0,
            detail="same 1024 rays, 64 samples, 8 × 256, L = 10/4, medians of the same round",
        ),
        Measurement("matrix.share", 2, "Share in the steady state", 66.1, "%", 63.9, 67.0, 5, target=65.0),
        Measurement("encoding.phi.ratio", 5, "φ recurrence against direct sin/cos", 3.9, "×", 3.7, 4.0, 9, target=3.0),
        Measurement(
            "truth.llvm", 7, "llvm_ad_rgb against scalar_rgb", None, "×", target=2.0,
            detail="no shared library of LLVM 16 or newer",
        ),
        Measurement("memory.reduced", 8, "Peak at `reduced`", 1.42, "GB", target=2.0, sense="at_most"),
        Measurement("memory.images", 8, "Growth with 4 × the images", 0.31, "GB", target=0.1, sense="at_most"),
        Measurement("processes.gain", 10, "Two processes against one", 1.31, "×", 1.28, 1.33, 3),
    ]  # fmt: skip
    for scene, (slow, same, reduced) in SCENES.items():
        found += [
            Measurement(f"target.{scene}.plain", 3, f"{scene}: plain", slow, "s", detail="" if slow else "never there"),
            Measurement(f"target.{scene}.same_network", 3, f"{scene}: same network", same, "s", same * 0.9, same, 3),
            Measurement(f"target.{scene}.reduced", 3, f"{scene}: reduced settings", reduced, "s"),
            Measurement(
                f"target.{scene}.same.ratio", 3, f"{scene}: same network, sooner by", slow / same if slow else None,
                "×", target=15.0, detail="" if slow else "plain never reached 22 dB within its 1800 s",
            ),
        ]  # fmt: skip
    return found


def series() -> list[Series]:
    ways = {"plain": 1.0, "same network": 0.1, "reduced settings": 0.01}
    found = [
        Series(
            f"PSNR against training seconds, {scene}", 3, way, "training seconds", "PSNR of test pixels (dB)",
            [scale * x for x in (10, 30, 100, 300, 1000)], [15, 18.1, 20.2, 22.0, 23.4], log_y=False,
        )
        for scene in ("chair", "lego")
        for way, scale in ways.items()
    ]  # fmt: skip
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
    write_speed(folder / "speed.json", fake_speed(**changes))
    return folder


def hostile(record: SpeedRecord, word: str) -> SpeedRecord:
    """`record` with `word` wherever it holds text of its own."""
    data = asdict(record)
    for row in data["measurements"]:
        row.update(title=word, detail=word, unit=word, id=word)
    for row in data["series"]:
        row.update(panel=word, name=f"{word} {row['name']}", x_label=word, y_label=word)
    for row in data["tables"]:
        row.update(title=word, columns=[word] * len(row["columns"]), rows=[[word] * len(one) for one in row["rows"]])
    named = {word: word, "processor": word, "device": word}
    return SpeedRecord(
        provenance=named,
        settings=json.loads(json.dumps({word: [word]})),
        measurements=[Measurement(**row) for row in data["measurements"]],
        series=[Series(**row) for row in data["series"]],
        tables=[Table(**row) for row in data["tables"]],
        seconds={word: 1.0},
    )
