"""The one table of stiff and extreme cases. A new case is a generator of findings and one entry here."""

from harness.records.study import PICTURES_FOLDER, StudyInfo
from harness.studies.framework import Shelf, Study, catalogue


def _case(
    id: str, title: str, measure: str, seconds: float, given: str, danger: str, reference: str, bar: str
) -> Study:
    facts = {"input": given, "danger": danger, "reference": reference, "bar": bar}
    return Study(StudyInfo(id, title, facts=facts), f"stability.{measure}", seconds)


# fmt: off
CASES: dict[str, Study] = catalogue(
    _case("Q1", "Homogeneous ray", "rays.quadrature_rounding:homogeneous", 5, "τ from 1e-8 to 1e8 over 1, 64 and 10^6 "
          "bins", "1 − exp(−τ) loses every digit below 3e-8 a bin; a running product drifts by 2.7e-3 over 10^6 bins",
          "c (1 − e^−τ) in 40 digits", "relative error of colour, opacity and transmittance (over max(1, τ)) ≤ 1e-6, "
          "measured 1.8e-7; half precision refused"),
    _case("Q2", "Order of convergence", "rays.quadrature_orders:orders", 15,
          "linear ramp, exponential and Gaussian density, 8 to 4096 bins, float64", "order is lost",
          "closed forms and mpmath", "fitted order within ±0.15 of the one that the rule declares"),
    _case("Q3", "Gradients of a ray", "rays.quadrature_rounding:gradients", 10,
          "one density and a ramp, τ of a bin from 1e-8 to 100",
          "the gradient of expm1 loses every digit; log space gives NaN where σ = 0",
          "∂C/∂σ_i = δ_i (T_{i+1} c_i − Σ_{j>i} w_j c_j)", "≤ 5e-6 of the largest gradient in float32, "
          "measured 4.9e-7; float64 and central differences to 1e-9"),
    _case("Q4", "Stiff rays", "rays.quadrature_orders:stiff", 6, "τ of a bin from 15 to 1000, colour varying",
          "order reduction: the colour of the first bin's middle is returned", "mpmath",
          "≤ 1.1 · h/2 · max|c′|; linear in τ ≤ 1e-4 from 64 bins on, measured 2.8e-5"),
    _case("Q5", "A shell thinner than a bin", "rays.quadrature_orders:shell", 4, "width δ/3 at a random offset",
          "missed altogether: error 0.9", "clipped integral", "share of rays missed is 1 − width/δ; with importance "
          "samples ≤ 1e-2; trapezoid, which misses that by construction, ≤ 0.06; left ends are shown"),
    _case("Q6", "Almost nothing", "rays.quadrature_edges:almost_nothing", 1, "σ = 1e-8 everywhere",
          "an interval of 1e10 makes it opaque, with a gradient of 1e9", "opacity 4e-8", "relative error ≤ 1e-6"),
    _case("Q7", "Nothing at all", "rays.quadrature_edges:nothing", 1, "near = far, no samples, an empty ray",
          "a false opaque hit; 0/0 in depth and disparity", "opacity 0, colour = background, depth = far",
          "exact and finite"),
    _case("Q8", "Intervals that are none", "rays.quadrature_edges:no_interval", 1,
          "far < near, far = ∞, unsorted distances", "opacity −53.6, or 1 where an interval of 1e10 hides it", "–",
          "refused, with the ray named"),
    _case("Q9", "One bad sample", "rays.quadrature_edges:bad_sample", 1, "σ = NaN, +∞ or negative in one sample",
          "nan_to_num hides it, or it spreads", "the other rays alone",
          "refused, with ray and sample named; other rays keep every bit"),
    _case("Q10", "Importance sampling at its edges", "rays.quadrature_edges:inverse_cdf_extremes", 1,
          "all weights zero, one spike, NaN; u = 0, 1 − ulp, 1", "0/0, an index out of range",
          "uniform, or inside the spike's bin", "sorted, inside [near, far]; NaN refused"),
    _case("E1", "Top frequency of an encoding", "rays.encoding_cases:top_frequency", 3, "x in [−1, 1], k = 9 and 13",
          "the product f_k π x is rounded", "mpmath", "L = 10: ≤ 1.2e-4 for 2^k, 2.5e-5 for φ^k, 1.2e-5 as printed; "
          "L = 14: 1.9e-3 and 1.6e-4"),
    _case("E2", "Positions that are none", "rays.encoding_cases:positions", 1,
          "x = 0, denormal, 1e-4, 1e2, 1e4, 1e38, ∞, NaN", "an error of 0.58 at 1e4; NaN", "mpmath",
          "outside ±1.0001 refused by the check; inside ≤ 1.2e-4; unchecked ones are judged where they are finite"),
    _case("E3", "Ghosts and neutral gratings", "rays.encoding_cases:ghosts", 25,
          "a burst with a gap at 2φ/√5, 0.894 and 1; gratings up to and over Nyquist",
          "distant points alias: 0.235 of the burst appears in the gap", "closed-form kernel; ratio 1.65 as control",
          "control ≤ 0.1 (measured 0.05); no grating within 1 % of what a ladder or two of its members make"),
    _case("A1", "Amplifier at its start", "fields.amplifier_cases:identity", 3, "α = 1/φ, β as printed",
          "not the identity", "identity", "≤ 1.2e-7"),
    _case("A2", "One view, many calls", "fields.unit_cases:chunks", 50, "rays in calls of 1, 16, 256, all; shuffled, "
          "padded, coarse and fine, training and scoring, after a reload",
          "the mean of the call: up to 0.3–0.77 of a pixel", "one call", "≤ 2e-6 (measured 2.4e-7)"),
    _case("A3", "One NaN among 4096 rays", "fields.amplifier_cases:one_nan", 5, "one sample NaN",
          "every ray of the call is NaN", "the other rays",
          "refused, with the number of the ray; that ray is lost and no other"),
    _case("A4", "A solid slab", "fields.amplifier_cases:slab", 5,
          "geometry one pixel thick at 100, 400 and 800 px: the classic camera, a box of ±1.5, units of the catalogue",
          "a bounded density never makes it opaque", "1 − e^−τ",
          "reachable opacity ≥ 0.99 at each resolution, else the PSNR that this allows"),
    _case("A5", "Extreme inputs of an amplifier", "fields.amplifier_cases:extremes", 10, "raw ±1e4, all equal; α −1, "
          "0, 10, 1e3, ∞ (the paper's raw parameter: nothing keeps it above 0); σ′ = 0.5 ± ulp",
          "dead gradients, inversion, 0 · ∞, a jump of β", "–",
          "outputs and gradients finite; dead share after training ≤ 0.01; sign recorded"),
    _case("A6", "A fresh field without help", "fields.fresh_fields:fresh_fields", 60,
          "a ball before white, 9 % of a view, in a box of ±1.5; no silhouettes, no occupancy grid, Adam at 5e-4, the "
          "paper's network; a small one before white and before grey",
          "what is opaque at first is painted white all over, and has no gradient for good",
          "a picture of background alone", "error of a held-out view ≤ 0.5 of that of the reference"),
    _case("O1", "Half precision", "fields.optimiser_cases:half_precision", 25,
          "float16 and bfloat16 products; gradients 0 and 1e-5", "NaN, −∞, frozen weights; an encoding error of 1",
          "float32", "weights, encoding, amplifier and quadrature stay float32; the loss within 5 % of float32's "
          "(measured 0.1 %)"),
    _case("O2", "One spike", "fields.optimiser_cases:spike", 60, "a gradient × 1e6, × 1e9 (NeRF; × 1e9 Q-NeRF and "
          "voxels as well), a NaN gradient; a cell trained twice",
          "Adam frozen for 2e4 to 3.3e4 steps; poisoned moments", "the same run without the spike", "back within 10 % "
          "in 200 steps; NaN ends the cell at a named step and tensor; trained twice: the same bits"),
    _case("O3", "Digits lost by layer", "fields.amplifier_cases:digits_by_layer", 15,
          "a trained network in bfloat16 and float16, fed the same inputs", "digits vanish layer by layer",
          "its float64 twin", "digits recorded; colours change by half an 8-bit step at most (measured 5e-4)"),
    _case("O4", "Badly conditioned matrices", "fields.optimiser_cases:conditioned", 5,
          "a quadratic loss of a 32 × 32 matrix, curvature from 1 to 1e-6 along either side, in no axis's direction",
          "bases drift off orthogonal, signs and order follow rounding", "the same steps in float64",
          "the loss within 25 % of float64's (measured 7 %); bases orthogonal to 1e-5"),
    _case("O5", "A training in float64", "fields.float64_twin:float64_twin", 120,
          "small trainings and their twins in float64, from the same weights, batches and draws; products in half "
          "precision for 40 steps", "rounding decides the result", "the twin",
          "the first loss to 1e-6 (measured 2e-7); test PSNR after 300 steps within 0.5 dB, as another seed's: the "
          "difference grows from step to step (measured 0.2)"),
    _case("G1", "Gaussians", "fields.primitive_cases:gaussians", 10, "one of 1e-4 to 1 of the box, from 2 to 200 away; "
          "a disc edge-on; 400 in another order; an opacity that rounds to 1",
          "a projection without extent; order by list; 0/0 behind what is opaque",
          "closed forms; central differences",
          "opacity ≤ 2e-6 (measured 2.4e-7); edge-on ≤ 1e-5; another order changes no bit; gradients finite, "
          "and ≤ 1e-6 of the largest in float64"),
    _case("G2", "Grids", "fields.primitive_cases:grids", 5, "points on the border, one ulp inside it and beyond; "
          "tables of 64 and of 1 entry for 226981 and 1000 nodes", "an index out of range; lost sums",
          "a plain composition in float64", "features and gradients ≤ 2e-5 of the largest (measured 5e-6)"),
    _case("S1", "Nothing to see", "whole_scenes.scene_cases:nothing_to_see", 170,
          "an empty scene, a black one, a constant white one", "no signal; PSNR ∞, SSIM 0/0", "analytic", "finite "
          "metrics; MSE ≤ 1e-5 (empty), 6e-3 (black), opacity outside ≤ 0.02; white: opacity inside the silhouette "
          "less that outside ≥ 0.5; a method that learnt nothing is recorded, not judged"),
    _case("S2", "Too close", "whole_scenes.scene_cases:too_close", 20, "an opaque wall that fills the view; a camera "
          "inside the object; none on its surface, where a view is one point",
          "the near plane saturates: training views 22 dB, test views 8 dB", "analytic depth", "rendered depth ≤ 1e-3; "
          "methods above a copy of the nearest training view; a planted billboard is named; a method's depth is "
          "recorded, not judged"),
    _case("S3", "Fog", "whole_scenes.scene_cases:fog", 6, "dense (τ = 50) and thin (τ = 1e-3)", "stiff; cancels",
          "closed form, and Mitsuba", "quadrature: opacity ≤ 1e-4, a colour that varies ≤ 2e-3; |z| < 4; opacity of "
          "methods: dense ≤ 0.03, thin: half a step of 8 bits"),
    _case("S4", "Wires thinner than a pixel", "whole_scenes.scene_cases:wires_thinner_than_a_pixel", 20,
          "a quarter of a pixel for methods; 1e-2 and 1e-4 of a pixel rendered",
          "rays through pixel centres miss; noisy truth", "covered area",
          "mean of the image |z| < 4; a method's error ≤ 0.9 of that of showing nothing (measured 0.14 to 0.36)"),
    _case("S5", "Mirror and glass", "whole_scenes.scene_cases:mirror_and_glass", 8,
          "a mirror; glass of index 1.5 and 1.0", "virtual depth; looks depend on the side",
          "rendered; index 1 must vanish", "index 1 within noise of nothing; of the variance within the silhouette "
          "methods explain: mirror ≥ 0.3, glass ≥ 0.5, glass of index 1 ≥ 0.3"),
    _case("S6", "Extreme light", "whole_scenes.scene_cases:extreme_light", 8,
          "an emitter of 1e6 : 1, a checker at the Nyquist limit, light at 89.9°, a furnace",
          "one pixel owns the loss; aliasing; long chords",
          "linear truth, box-filtered checker, analytic chord, E / (1 − ρ)", "rendered median ≤ 10 %, a method's "
          "≤ 25 %; the lamp owns at most half of the squared error of display colour; checker equals its box mean, a "
          "method's error on it ≤ 0.4 of that of showing nothing; grazing light: half of the variance; chord ≤ 1e-4; "
          "furnace |z| < 4, MSE ≤ 1e-3"),
    _case("S7", "Far too small, large or far away", "whole_scenes.scene_cases:scaled", 10,
          "scale 1e-4 and 1e4, offset 1e3 to 1e5", "Mitsuba's ray epsilon brightens by 9 %", "the scene at unit scale",
          "normalised: within noise, methods within 1.5 dB of each other; as it is: refused"),
    _case("S8", "Another unit of length", "fields.unit_cases:units_of_length", 60,
          "poses, box, near and far × 0.1, 8, 10 and 25, after all normalisation",
          "density per unit of length: what a method can show depends on the author's choice of metre",
          "the same training in the first unit", "× 8 changes no bit of a score; × 0.1, 10 and 25 change it by 0.5 dB "
          "at most, as rounding grows; density per scene unit, as printed, is the paper's and depends on it"),
    _case("C1", "Cameras that are none", "rays.camera_cases:cameras", 5, "NaN, singular, origin on target, up along "
          "the view, field of view 0 or 180°; axis-parallel rays, directions of other length, the same view twice",
          "Mitsuba renders a clean background in silence; 0/0 in the slab test", "–",
          "refused before rendering; opacity does not depend on the length of d"),
    _case("C2", "Odd sizes", "fields.unit_cases:odd_sizes", 10,
          "images of 1 × 1, 1 × N, 3 × 5; one ray; a last, partial call",
          "squeezed axes, SSIM windows, a mean of the call", "a loop over rays", "≤ 2e-6"),
    _case("R1", "An independent reference", "rays.reference_cases:independent", 15,
          "a random 16³ grid, τ of a voxel up to 5", "any of the above",
          "Mitsuba's volpath, lit along the camera ray; Dr.Jit on Mitsuba's gridvolume; closed forms of layers",
          "|z| < 4; values and σ-gradients ≤ 5e-6, colour gradients ≤ 1e-4; closed forms ≤ 1e-6, and 5e-4 for the "
          "first-order left ends (measured 1.7e-4)"),
    _case("L1", "Ladders", "whole_scenes.ladder_cases:ladders", 240,
          "scenes that get harder rung by rung: frequency, thinness, density, dynamic range, scale",
          "every method breaks somewhere", "rendered truth", "a method breaks on the first rung of which it explains "
          "less than half of the variance; of five, ours climb at least 1 of frequency and of dynamic range, 2 of "
          "thinness, 5 of density and 5 of scale, the control"),
    _case("N1", "What a scene does not need", "whole_scenes.ladder_cases:omissions", 120,
          "cells trained with and without each omission", "an omission that costs more than it saves",
          "the same cell with nothing left out", "change in error within its bound by its whole 95 % interval; one "
          "that is not settled counts as not measured"),
)
# fmt: on

SHELF = Shelf("stability", "cases", CASES, folders=(PICTURES_FOLDER,))
