"""The table of the frontier's studies. A new study is a generator of findings and one entry here."""

from harness.studies.framework import TRAININGS_FOLDER, Shelf, Study, asking, catalogue

AT_BUDGETS = "budgets"
AT_LARGE_BUDGETS = "large_budgets"
"""Stand for the trainings of all budgets, of usual and of larger pictures."""

STUDIES: dict[str, Study] = catalogue(
    asking("error_against_time", "Error against core seconds",
           "Which family has the smallest error after which time?",
           "Every family trains on the same views at every budget of core seconds, each time with a separate schedule: "
           "a point of a curve is not an early part of a longer training. The number of Gaussians follows the budget; "
           "the other families have one size at all budgets. The error is that of the test views' display colours, and "
           "next to it that of depth.",
           "error_against_time:error_against_time", 10, AT_BUDGETS),
    asking("front", "Who is ahead, and how surely",
           "Which family is best at which budget, and where does one overtake another?",
           "Scenes are drawn with replacement. The share of draws in which a family has the best mean, or is on the "
           "Pareto front of time and quality, is its probability; with few scenes it overstates certainty.",
           "front:front", 5, AT_BUDGETS),
    asking("needs", "What does a scene need?",
           "Which family suits which scene?",
           "The best family on each scene and kind of scene at the longest budget, compared with the second best.",
           "needs:needs", 5, AT_BUDGETS),
    asking("costs", "What a trained model costs",
           "How large is a model, and how long does drawing a view take?",
           "Trained models of the longest budget: weights, bytes on disk, and the median time of drawing one test view "
           "at 100 and at 400 pixels, on all threads; how many scenes reach 25, 28 and 30 dB, and when.",
           "costs:costs", 60, AT_BUDGETS),
    asking("larger", "Larger pictures",
           "Is the leader the same with larger pictures?",
           "Families train on larger views of fewer scenes, with as much noise as those of a default run; all other "
           "settings are as above.",
           "error_against_time:larger", 5, AT_LARGE_BUDGETS),
    asking("peers", "Other programs",
           "What do programs of others reach on a processor?",
           "Scores that others measured on views of this project, beside ours; each row names its protocol. No other "
           "published curve of several families on a processor was found.",
           "peers:peers", 5, AT_BUDGETS),
    asking("phi", "The golden ratio in grids",
           "Does golden-ratio spacing of resolutions help planes or a hash grid?",
           "Resolutions that grow by φ are compared with a factor near 2 with the same coarsest and finest level, and "
           "with one with an equal number of learnt numbers, all trained for the same core seconds.",
           "phi:phi", 10, "phi"),
)  # fmt: skip

SHELF = Shelf("frontier", "questions", STUDIES, folders=(TRAININGS_FOLDER,))
