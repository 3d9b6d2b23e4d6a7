"""A made-up frontier: two families at two budgets, and what φ changes."""

from harness.records.study import Answer, Effect, Series, Studies, StudyRecord, Table
from harness.records.verdict import OPEN
from harness.studies.frontier.error_against_time import ERROR
from harness.studies.frontier.frontier_studies import STUDIES
from tests.reports.fake_shelf import PROVENANCE, shelf

PANEL, AXIS = "Error against core seconds of training, all scenes", "core seconds of training"


def fake_frontier() -> Studies:
    lines = [
        Series(
            PANEL, 0, family, AXIS, ERROR, [4.0, 60.0], [first, last], [0.8 * first, 0.8 * last], [1.2 * first, last]
        )
        for family, first, last in (("nerf", 0.1, 0.04), ("splats", 0.04, 0.02))
    ]
    means = Table("over_scenes", 0, "PSNR over scenes, dB", ["family", "4 core s"], [["nerf", "20.46 ± 1.58"]])
    found = [Answer("At 60 core seconds splats has the best mean over 8 scenes, 33.98 dB."), *lines, means]
    gain, ends = 0.4, (-0.1, 0.9)
    grown = Effect(
        "planes_phi", "planes_same_ends", "all", "psnr", "core_seconds", gain, ends, ends, 1, OPEN, 0.7, 16, 0
    )
    studies = [
        StudyRecord(STUDIES["error_against_time"].info, "8 scenes", found, 3000.0),
        StudyRecord(STUDIES["phi"].info, "8 scenes", [Answer("φ changes planes by +0.40 dB."), grown], 700.0),
    ]
    settings = {"amount": {"scenes": ["chair", "ship"], "seeds": [0]}, "device": "cpu"}
    return shelf("frontier", studies, settings, {"provenance": PROVENANCE})
