"""The terms of the page that a reader from another field may not know."""

WORDS = (
    ("cell", "One method, trained on one scene with one seed."),
    (
        "seed",
        "The number that determines the initial weights and the batches. Methods are compared in pairs with the same "
        "scene and seed, on the same rays.",
    ),
    (
        "equal steps, equal training time, equal core seconds",
        "The budget that two methods share. At equal time the slower one is evaluated before its last step, and before "
        "its learning rate has decayed fully.",
    ),
    (
        "core second",
        "A second of one processor core, spent on this training and on making its batches. Other programs on the "
        "machine make wall times too long, and change core seconds little. Where several threads spin while they wait "
        "for each other, core seconds are too long as well; the cell then carries a warning.",
    ),
    ("floor", "The score of the nearest training photo, shown in place of a rendering. Below it nothing was learnt."),
    ("ceiling", "The score of a perfect method: the ground truth is rendered, and has noise itself."),
    (
        "95 % interval",
        "Of 100 intervals made this way, 95 hold the true difference. Where several differences are judged together, "
        "the intervals are wider, so that all of them hold at once.",
    ),
    (
        "on these scenes, on scenes like these",
        "The first interval answers what other seeds would give on the same scenes. The second answers what to expect "
        "of a scene that was not tried; it is wider, as scenes differ.",
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
        "p: how often chance would bring a difference at least this large, adjusted for all comparisons of the "
        "headline. q: the expected share of false ones among all rows of a table that differ at least as clearly.",
    ),
    (
        "robust",
        "A mean that one bad cell does not move: medians over seeds, then the median over pairs of scenes. A sentence "
        "says where the mean lies outside its interval.",
    ),
    ("smallest detectable", "The sign of a true difference of this size would be found in 80 of 100 repetitions."),
    (
        "bandwidth",
        "The highest frequency of the positional encoding. nerf_matched is nerf with the lower bandwidth that the "
        "golden ratio gives: its own gain does not come from the golden ratio.",
    ),
    (
        "gain of the last doubling",
        "PSNR at the end minus PSNR at half of the steps: how far training is from convergence. The learning rate is "
        "still high at half of the steps, so that doubling a long training brings less than this.",
    ),
    ("diverged", "A number became infinite or NaN. The run has no score, and stays visible."),
    ("empty collapse", "The method shows little but background."),
    ("billboard", "Training views score far above test views, which are below the floor: no scene was learnt."),
    ("profile", "The size of a run: pixels, steps, seeds and methods."),
)
