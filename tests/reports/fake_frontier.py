"""A made-up frontier: two families at two budgets."""

from harness.records.study import Answer, Series, Studies, StudyRecord, Table
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
    studies = [StudyRecord(STUDIES["error_against_time"].info, "8 scenes", found, 3000.0)]
    settings = {"amount": {"scenes": ["chair", "ship"], "seeds": [0]}, "device": "cpu"}
    return shelf("frontier", studies, settings, {"provenance": PROVENANCE})
