"""The studies that support a verdict. A new study is a generator of findings and one entry here."""

from harness.studies.framework import TRAININGS_FOLDER, Shelf, Study, asking, catalogue

STUDIES: dict[str, Study] = catalogue(
    asking("calibration", "Are the intervals calibrated?",
           "How often do the intervals hold the truth, and how often is an existing effect found?",
           "Simulated studies of known truth, judged by the functions that judge a run: 4 to 16 scenes, 3 to 10 seeds, "
           "effects that differ by 0 to 0.6 dB from scene to scene, normal noise, heavy tails, and runs that collapse.",
           "calibration:calibration", 15),
    asking("positive_controls", "Does it find what is known?",
           "Does the comparer find the losses that the original NeRF's ablation found?",
           "NeRF without positional encoding, without view direction, with half and with a quarter of the training "
           "views where these are few, and with 7 and 15 % fewer steps, each against NeRF, judged like Q-NeRF.",
           "positive_controls:positive_controls", 5400,
           "no_encoding", "no_direction", "images", "half_images", "quarter_images", "full_steps", "steps_850",
           "steps_930"),
    asking("ceilings", "Is the noise ceiling right?",
           "Does the PSNR ceiling that follows from the ground truth's own variance agree with an independent render?",
           "Every test view is rendered once more with other random numbers; half of the mean square difference of two "
           "renders is the noise of one.",
           "ceilings:ceilings", 90),
    asking("factorial", "What does each part do?",
           "What do the φ encoding, the amplifier and the φ skip contribute, alone and together?",
           "All eight combinations of the three parts, under both readings of the amplifier: main effects, "
           "interactions, and the cumulative rows of Table 4.",
           "factorial:factorial", 540, "factorial"),
    asking("bandwidth", "The golden ratio, or bandwidth?",
           "Is what the φ encoding changes due to φ, or to how far its frequencies reach?",
           "φ with NeRF's reach, another base with φ's reach, and 2^k with φ's reach, compared with both, at three "
           "resolutions and along training, on all eight scenes with one seed, as intervals over scenes need no "
           "repeats.",
           "bandwidth:bandwidth", 2000, "bandwidth_100", "bandwidth_200", "bandwidth_300"),
    asking("objections", "What if it were compared otherwise?",
           "Does the verdict change with the start of the field, the encoding of NeRF or the paper's quadrature, or "
           "without silhouettes or the amplifier?",
           "Pairs of methods that differ in what is objected to, on all eight scenes with one seed, judged like the "
           "headline; those with Eq. 4 are rendered again without it.",
           "objections:objections", 3000, "objections", "no_silhouettes"),
    asking("collapse", "Does a training end without a picture?",
           "How often does a training diverge, end empty, or score below a copy of the nearest training view?",
           "Five readings of density with ten seeds in the scenes' own boxes, and thin scenes in cubes of up to "
           "twice their size. Trainings are short, as a collapse happens early.",
           "collapse:collapse", 2000, "box_own", "box_1_5", "box_1_8", "box_2_4"),
)  # fmt: skip

SHELF = Shelf("evidence", "studies", STUDIES, folders=(TRAININGS_FOLDER,), in_run_folder=True)
