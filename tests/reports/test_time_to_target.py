"""When a mean curve crosses a score."""

import pandas as pd
import pytest

from reports.time_to_target import reached_at, savings


def curve(method: str, steps: list[int], psnr: list[float], scene: str = "lego", seed: int = 0) -> pd.DataFrame:
    rows = {"method": method, "scene": scene, "seed": seed, "step": steps, "psnr": psnr}
    return pd.DataFrame({**rows, "seconds": [0.5 * step for step in steps]})


def test_crossing_lies_on_a_line_over_the_log_axis():
    points = curve("nerf", [10, 1000], [20.0, 40.0])
    assert reached_at(points, 1, "step", 30.0) == pytest.approx(100)
    assert reached_at(points, 1, "seconds", 30.0) == pytest.approx(50)


def test_a_crossing_before_the_first_checkpoint_is_unknown():
    assert reached_at(curve("nerf", [10, 100], [31.0, 33.0]), 1, "step", 30.0) is None


def test_a_curve_that_stays_below_never_crosses():
    assert reached_at(curve("nerf", [10, 100], [20.0, 29.9]), 1, "step", 30.0) is None


def test_checkpoints_that_lack_a_scene_do_not_count():
    both = pd.concat([curve("nerf", [10, 100], [20.0, 40.0]), curve("nerf", [10], [20.0], "mic")])
    assert reached_at(both, 2, "step", 30.0) is None


def test_savings_in_per_cent_for_each_seed():
    parts = [curve("nerf", [10, 1000], [20.0, 40.0], seed=seed) for seed in (0, 1)]
    parts += [curve("qnerf", [8, 800], [20.0, 40.0], seed=seed) for seed in (0, 1)]
    assert savings(pd.concat(parts), "step", 30.0) == pytest.approx([20.0, 20.0])


def test_one_seed_that_never_arrives_spoils_all():
    parts = [curve(name, [10, 1000], [20.0, 40.0]) for name in ("nerf", "qnerf")]
    parts += [curve("nerf", [10, 1000], [20.0, 40.0], seed=1), curve("qnerf", [10, 1000], [20.0, 25.0], seed=1)]
    assert savings(pd.concat(parts), "step", 30.0) == []


def test_a_method_that_lost_a_scene_is_not_compared_on_the_rest():
    parts = [curve("nerf", [10, 1000], [20.0, 40.0], scene) for scene in ("lego", "mic")]
    assert savings(pd.concat([*parts, curve("qnerf", [10, 1000], [20.0, 40.0])]), "step", 30.0) == []
