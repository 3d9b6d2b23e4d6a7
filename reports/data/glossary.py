"""The words of the page that a reader from another field would look up."""

WORDS = (
    ("cell", "One method, trained on one scene with one seed."),
    (
        "seed",
        "The number from which the first weights and the batches are drawn. Methods are compared in pairs: of the same "
        "scene and the same seed, on the same rays.",
    ),
    (
        "equal steps, equal training time, equal core seconds",
        "What two methods are given the same of. At equal time the slower one is read before its last step, and before "
        "its learning rate has fallen all the way.",
    ),
    (
        "core second",
        "A second of one processor core, used only by this training, the making of its batches included. Other "
        "programs on the machine make wall times too long, and change core seconds little. They too are too long where "
        "several threads wait for each other actively; a cell then carries a warning.",
    ),
    ("floor", "The score of the nearest training photo, shown in place of a rendering. Below it nothing was learnt."),
    ("ceiling", "The score of a perfect method: the ground truth itself is rendered, and has noise."),
    (
        "95 % interval",
        "Made this way, 95 of 100 intervals hold the true difference. Where several differences are looked at "
        "together, it is wider, so that all of them do.",
    ),
    (
        "on these scenes, on scenes like these",
        "The first asks what other seeds would give on the same scenes. The second asks what to expect of a scene that "
        "was not tried; it is wider, as scenes differ.",
    ),
    (
        "sign: above 0, below 0, open",
        "Whether the whole interval of a difference lies above or below 0. Whether above is good depends on the score: "
        "the colour says so.",
    ),
    (
        "size: matters, smaller than matters, open",
        "Whether the whole interval lies beyond, or within, the smallest difference of interest (0.2 dB of PSNR). Sign "
        "and size are two questions: a difference may be above 0 and smaller than matters.",
    ),
    (
        "p, q",
        "p: how often chance alone would bring so large a difference, adjusted for all that the headline compares. q: "
        "the share of false ones to expect among all rows of a table that differ as clearly as this one, or more so.",
    ),
    (
        "robust",
        "A mean that one bad cell does not move: medians over seeds, then the median over pairs of scenes. It is shown "
        "where it disagrees with the mean.",
    ),
    ("smallest detectable", "The sign of a true difference of this size would be found in 80 of 100 repetitions."),
    (
        "bandwidth",
        "The highest frequency of the positional encoding. nerf_matched is nerf with the lower bandwidth that the "
        "golden ratio gives: its own gain does not come from the golden ratio.",
    ),
    (
        "gain of the last doubling",
        "PSNR at the end, less that at half of the steps: how far training is from its end. The learning rate is "
        "still high at half of the steps: after long training, twice as many bring less than this.",
    ),
    ("diverged", "A number became infinite or NaN. The run has no score, and stays visible."),
    ("empty collapse", "The method shows little but background."),
    ("billboard", "Training views are far better than test views, which are below the floor: pictures, no scene."),
    ("profile", "The size of a run: pixels, steps, seeds and methods."),
)
