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
        "What two methods are given the same of. At equal time the slower one is met before its last step, and before "
        "its learning rate has fallen all the way.",
    ),
    (
        "core second",
        "A second of one processor core, used by this training alone, the making of its batches included. Other "
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
        "better, worse, equivalent, inconclusive",
        "Better and worse: 0 lies outside of the interval. Equivalent: the interval holds nothing larger than the "
        "smallest difference of interest (0.2 dB of PSNR). Inconclusive: neither.",
    ),
    ("smallest detectable", "A true difference of this size would be called better or worse in 80 of 100 repetitions."),
    (
        "bandwidth",
        "The highest frequency of the positional encoding. nerf_matched is nerf with the lower bandwidth that the "
        "golden ratio gives: what it gains as well is no merit of the golden ratio.",
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
