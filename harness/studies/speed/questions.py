"""The questions about speed. A new question is a generator of findings and one entry here; numbers are not reused."""

from harness.plan.defaults import PLAIN_SECONDS
from harness.records.study import StudyInfo
from harness.studies.framework import Shelf, Study, catalogue

QUICK_SECONDS = 4


QUESTIONS: dict[str, Study] = catalogue(
    Study(StudyInfo("1", "Training throughput at the paper's network"), "throughput:measure", 50),
    Study(StudyInfo("2", "Share of the machine's matrix rate"), "throughput:share_of_matrix_rate", 140),
    # the plain training, then the others, each on its own clock; evaluations are off the clock
    Study(StudyInfo("3", "Time to a target PSNR"), "time_to_target:measure", 1.3 * PLAIN_SECONDS),
    Study(StudyInfo("4", "Full-frame rendering"), "rendering_speed:rendering", 45),
    Study(StudyInfo("7", "Ground truth by Mitsuba variant"), "rendering_speed:ground_truth", 80),
    Study(StudyInfo("8", "Peak memory"), "memory:measure", 720),
    Study(StudyInfo("11", "What each acceleration gains"), "accelerations:measure", 60),
)
SHELF = Shelf("speed", "questions", QUESTIONS)
