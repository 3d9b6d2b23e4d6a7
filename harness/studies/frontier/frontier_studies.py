"""The one table of what the frontier asks. A new study is a generator of findings and one entry here."""

from harness.studies.framework import TRAININGS_FOLDER, Shelf, Study, asking, catalogue

AT_BUDGETS = "budgets"
"""The trainings of a study that looks at every budget."""

STUDIES: dict[str, Study] = catalogue(
    asking("error_against_time", "Error against core seconds",
           "Which family has the smallest error after which time?",
           "Every family trains on the same views at every budget of core seconds, each time to a schedule of its own; "
           "what stands in a curve at one budget is no early part of a longer training. The error is that of the test "
           "views' display colours.",
           "error_against_time:error_against_time", 10, AT_BUDGETS),
    asking("front", "Who is ahead, how surely",
           "Which family is best at which budget, and where does one overtake another?",
           "Scenes are drawn with replacement. The share of draws in which a family has the best mean, or is on the "
           "Pareto front of time and quality, is its probability; few scenes make it look surer than it is.",
           "front:front", 5, AT_BUDGETS),
    asking("needs", "What does a scene need?",
           "Which family to take for which scene?",
           "The best family on each scene and kind of scene at the longest budget, against the second best.",
           "needs:needs", 5, AT_BUDGETS),
    asking("costs", "What a trained model costs",
           "How large is a model, and how long does it draw a view?",
           "Trained models of the longest budget: weights, bytes on disk, and the median of drawings of one test view "
           "at 100 and at 400 pixels, on every thread; how many scenes reach 25, 28 and 30 dB, and by when.",
           "costs:costs", 60, AT_BUDGETS),
    asking("phi", "The golden ratio in grids",
           "Does golden-ratio spacing of resolutions help planes or a hash grid?",
           "Resolutions that grow by φ against a factor near 2 with the same coarsest and finest level, and against "
           "one with as many learnt numbers, all trained for the same core seconds.",
           "phi:phi", 10, "phi"),
)  # fmt: skip

SHELF = Shelf("frontier", "questions", STUDIES, folders=(TRAININGS_FOLDER,))
