"""The table of stiff and extreme cases. A new case is a generator of findings and one entry here."""

from harness.records.study import StudyInfo
from harness.studies.framework import Shelf, Study, catalogue


def _case(id: str, title: str, measure: str, seconds: float, given: str, danger: str, reference: str) -> Study:
    """Return a case; its limits are read from its checks once it is measured (`framework.with_bar`)."""
    facts = {"input": given, "danger": danger, "reference": reference}
    return Study(StudyInfo(id, title, facts=facts), measure, seconds)


# fmt: off
CASES: dict[str, Study] = catalogue(
    _case("Q1", "Homogeneous ray", "rays.quadrature_rounding:homogeneous", 5,
          "τ from 1e-8 to 1e8 over 1, 64 and 10^6 bins",
          "1 − exp(−τ) loses every digit below 3e-8 per bin; a running product drifts by 2.7e-3 over 10^6 bins",
          "c (1 − e^−τ) in 40 digits"),
    _case("Q2", "Order of convergence", "rays.quadrature_orders:orders", 15,
          "linear ramp, exponential and Gaussian density, 8 to 4096 bins, float64", "order is lost",
          "closed forms and mpmath"),
    _case("Q3", "Gradients of a ray", "rays.quadrature_rounding:gradients", 10,
          "one density and a ramp, τ of a bin from 1e-8 to 100",
          "the gradient of expm1 loses every digit; log space gives NaN where σ = 0",
          "∂C/∂σ_i = δ_i (T_{i+1} c_i − Σ_{j>i} w_j c_j)"),
    _case("Q4", "Stiff rays", "rays.quadrature_orders:stiff", 6, "τ of a bin from 15 to 1000, colour varying",
          "order reduction: the colour of the first bin's middle is returned", "mpmath"),
    _case("Q5", "A shell thinner than a bin", "rays.quadrature_orders:shell", 4, "width δ/3 at a random offset",
          "missed completely: error 0.9", "clipped integral"),
    _case("Q6", "Almost nothing", "rays.quadrature_edges:almost_nothing", 1, "σ = 1e-8 everywhere",
          "an interval of 1e10 makes it opaque, with a gradient of 1e9", "opacity 4e-8"),
    _case("Q7", "Nothing at all", "rays.quadrature_edges:nothing", 1, "near = far, no samples, an empty ray",
          "a false opaque hit; 0/0 in depth and disparity", "opacity 0, colour = background, depth = far"),
    _case("Q8", "Invalid intervals", "rays.quadrature_edges:no_interval", 1,
          "far < near, far = ∞, unsorted distances", "opacity −53.6, or 1 where an interval of 1e10 hides it", "–"),
    _case("Q9", "One bad sample", "rays.quadrature_edges:bad_sample", 1, "σ = NaN, +∞ or negative in one sample",
          "nan_to_num hides it, or it spreads", "the other rays only"),
    _case("Q10", "Importance sampling at its edges", "rays.quadrature_edges:inverse_cdf_extremes", 1,
          "all weights zero, one spike, NaN; u = 0, 1 − ulp, 1", "0/0, an index out of range",
          "uniform, or inside the spike's bin"),
    _case("E1", "Top frequency of an encoding", "rays.encoding_cases:top_frequency", 3, "x in [−1, 1], k = 9 and 13",
          "the product f_k π x is rounded", "mpmath"),
    _case("E2", "Invalid positions", "rays.encoding_cases:positions", 1,
          "x = 0, denormal, 1e-4, 1e2, 1e4, 1e38, ∞, NaN", "an error of 0.58 at 1e4; NaN", "mpmath"),
    _case("E3", "Ghosts and neutral gratings", "rays.encoding_cases:ghosts", 25,
          "a burst with a gap at 2φ/√5, 0.894 and 1; gratings up to and over Nyquist",
          "distant points alias: 0.235 of the burst appears in the gap", "closed-form kernel; ratio 1.65 as control"),
    _case("A1", "Amplifier at its start", "fields.amplifier_cases:identity", 3, "α = 1/φ, β as printed",
          "not the identity", "identity"),
    _case("A2", "One view, many chunks", "fields.unit_cases:chunks", 50,
          "rays in chunks of 1, 16, 256, all; shuffled, padded, coarse and fine, training and scoring, after a reload",
          "the mean of the chunk: up to 0.3–0.77 of a pixel", "one chunk"),
    _case("A3", "One NaN among 4096 rays", "fields.amplifier_cases:one_nan", 5, "one sample NaN",
          "every ray of the chunk is NaN", "the other rays"),
    _case("A4", "A solid slab", "fields.amplifier_cases:slab", 5,
          "geometry one pixel thick at 100, 400 and 800 px: the classic camera, a box of ±1.5, units of the catalogue",
          "a bounded density never makes it opaque", "1 − e^−τ"),
    _case("A5", "Extreme inputs of an amplifier", "fields.amplifier_cases:extremes", 10, "raw ±1e4, all equal; α −1, "
          "0, 10, 1e3, ∞ (the paper's raw parameter: nothing keeps it above 0); σ′ = 0.5 ± ulp",
          "dead gradients, inversion, 0 · ∞, a jump of β", "–"),
    _case("A6", "A fresh field without help", "fields.fresh_fields:fresh_fields", 60, "a ball on white, 9 % of a "
          "view, in a box of ±1.5; no silhouettes, no occupancy grid, Adam at 5e-4, the paper's network; a small one "
          "on white and on grey",
          "a field that is opaque at first becomes white everywhere, and has no gradient from then on",
          "a picture of the background only"),
    _case("O1", "Half precision", "fields.optimiser_cases:half_precision", 25,
          "float16 and bfloat16 matrix multiplications; gradients 0 and 1e-5",
          "NaN, −∞, frozen weights; an encoding error of 1", "float32"),
    _case("O2", "One spike", "fields.optimiser_cases:spike", 60,
          "a gradient × 1e6, × 1e9 (NeRF; × 1e9 Q-NeRF and voxels as well), a NaN gradient; a cell trained twice",
          "Adam frozen for 2e4 to 3.3e4 steps; poisoned moments", "the same run without the spike"),
    _case("O3", "Digits lost by layer", "fields.amplifier_cases:digits_by_layer", 15,
          "a trained network in bfloat16 and float16, fed the same inputs", "digits vanish layer by layer",
          "its float64 twin"),
    _case("O4", "Badly conditioned matrices", "fields.optimiser_cases:conditioned", 5,
          "a quadratic loss of a 32 × 32 matrix, curvature from 1 to 1e-6 along either side, along no axis",
          "bases drift off orthogonal, signs and order follow rounding", "the same steps in float64"),
    _case("O5", "A training in float64", "fields.float64_twin:float64_twin", 120, "small trainings and their twins in "
          "float64, from the same weights, batches and draws",
          "rounding decides the result", "the twin"),
    _case("G1", "Gaussians", "fields.primitive_cases:gaussians", 10, "one of 1e-4 to 1 of the box, from 2 to 200 "
          "away; a disc edge-on; a ball beside the camera; 400 in another order; an opacity that rounds to 1",
          "a projection without extent; order by list; 0/0 behind what is opaque", "closed forms; central differences"),
    _case("G2", "Grids", "fields.primitive_cases:grids", 5,
          "points on the border, one ulp inside it and beyond; tables of 64 and of 1 entry for 226981 and 1000 nodes",
          "an index out of range; lost sums", "a plain composition in float64"),
    _case("S1", "Nothing to see", "whole_scenes.scene_cases:nothing_to_see", 170,
          "an empty scene, a black one, a constant white one", "no signal; PSNR ∞, SSIM 0/0", "analytic"),
    _case("S2", "Too close", "whole_scenes.scene_cases:too_close", 20, "an opaque wall that fills the view; a camera "
          "inside the object; no camera on its surface, where a view is one point",
          "the near plane saturates: training views 22 dB, test views 8 dB", "analytic depth"),
    _case("S3", "Fog", "whole_scenes.scene_cases:fog", 6, "dense (τ = 50) and thin (τ = 1e-3)", "stiff; cancels",
          "closed form, and Mitsuba"),
    _case("S4", "Wires thinner than a pixel", "whole_scenes.scene_cases:wires_thinner_than_a_pixel", 20,
          "a quarter of a pixel for methods; 1e-2 and 1e-4 of a pixel rendered",
          "rays through pixel centres miss; noisy truth", "covered area"),
    _case("S5", "Mirror and glass", "whole_scenes.scene_cases:mirror_and_glass", 8,
          "a mirror; glass of index 1.5 and 1.0", "virtual depth; appearance depends on the direction",
          "rendered; index 1 must vanish"),
    _case("S6", "Extreme light", "whole_scenes.scene_cases:extreme_light", 8,
          "an emitter of 1e6 : 1, a checker at the Nyquist limit, light at 89.9°, a furnace",
          "one pixel owns the loss; aliasing; long chords",
          "linear truth, box-filtered checker, analytic chord, E / (1 − ρ)"),
    _case("S7", "Far too small, large or far away", "whole_scenes.scene_cases:scaled", 10,
          "scale 1e-4 and 1e4, offset 1e3 to 1e5", "Mitsuba's ray epsilon brightens by 9 %", "the scene at unit scale"),
    _case("S8", "Another unit of length", "fields.unit_cases:units_of_length", 60,
          "poses, box, near and far × 0.1, 8, 10 and 25, after all normalisation",
          "density per unit of length: what a method can show depends on the author's unit",
          "the same training in the first unit"),
    _case("C1", "Invalid cameras", "rays.camera_cases:cameras", 5, "NaN, singular, origin on target, up along "
          "the view, field of view 0 or 180°; axis-parallel rays, directions of other length, the same view twice",
          "Mitsuba renders a clean background in silence; 0/0 in the slab test", "–"),
    _case("C2", "Odd sizes", "fields.unit_cases:odd_sizes", 10,
          "images of 1 × 1, 1 × N, 3 × 5; one ray; a last, partial chunk",
          "squeezed axes, SSIM windows, a mean of the chunk", "a loop over rays"),
    _case("R1", "An independent reference", "rays.reference_cases:independent", 15,
          "a random 16³ grid, τ of a voxel up to 5", "any of the above",
          "Mitsuba's volpath, lit along the camera ray; Dr.Jit on Mitsuba's gridvolume; closed forms of layers"),
    _case("L1", "Ladders", "whole_scenes.ladder_cases:ladders", 240,
          "scenes that get harder rung by rung: frequency, thinness, density, dynamic range, scale",
          "every method breaks at some rung", "rendered ground truth"),
)
# fmt: on

SHELF = Shelf("stability", "cases", CASES)
