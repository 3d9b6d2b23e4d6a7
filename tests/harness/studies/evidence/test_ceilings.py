"""Ceilings against independent renders, from simulated noise; and the process that renders, played by a script."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.records.study import Check, Table
from harness.studies.evidence.ceilings import TOLERANCE_DB, agreement, judged, limited, noise_rows
from scenes.files.errors import InputError

VIEWS = 15
TRUE_MSE = 1e-4


def estimates(seed: int, factor: float = 1.0) -> list[float]:
    """What 15 views say of their noise: 40.0 dB, each a tenth off by chance."""
    return list(factor * TRUE_MSE * np.exp(np.random.default_rng(seed).normal(0.0, 0.02, VIEWS)))


def found(scenes: int = 8, factor: float = 1.0) -> list[Any]:
    return [
        agreement(f"scene{k}", estimates(3 * k), estimates(3 * k + 1, factor), estimates(3 * k + 2))
        for k in range(scenes)
    ]


def checks(of: list[Any]) -> list[Check]:
    return [one for one in judged(of) if isinstance(one, Check)]


def test_a_known_variance_is_a_known_ceiling() -> None:
    one = agreement("lego", [1e-4, 1e-3], [1e-4, 1e-4], [1e-2, 1e-3])
    assert (one.stated, one.again, one.halves, one.views) == pytest.approx((35.0, 40.0, 25.0, 2))
    assert one.difference == pytest.approx(-5.0)
    assert one.error == pytest.approx(5.0)  # the differences are 0 and −10
    assert one.excess() == pytest.approx((5.0 - TOLERANCE_DB) / 5.0)


def test_equal_noise_agrees() -> None:
    mean, worst, _ = checks(found())
    assert mean.holds
    assert worst.holds
    assert worst.value == 0.0
    sentence = next(iter(judged(found())))
    assert isinstance(sentence, str)
    assert sentence.startswith("8 of 8 ceilings lie within 0.1 dB")


@pytest.mark.parametrize("factor", [2.0, 0.5, 4.0, 1.05])
def test_a_wrong_factor_is_caught(factor: float) -> None:
    """5 % is 0.21 dB, and the eight scenes together show it to 0.01 dB."""
    mean, worst, _ = checks(found(factor=factor))
    assert mean.value == pytest.approx(10 * np.log10(factor), abs=0.05)
    assert not mean.holds
    assert not worst.holds


def test_one_wrong_scene_is_caught_though_the_mean_holds() -> None:
    scenes = [*found(7), agreement("odd", estimates(1), estimates(2, 1.15), estimates(3))]
    mean, worst, _ = checks(scenes)
    assert mean.holds
    assert not worst.holds


def test_a_scene_whose_views_differ_too_much_to_tell_is_not_called_wrong() -> None:
    wide = agreement("mic", [1e-4 * 1.5, 1e-4 / 1.1, 1e-4], [1e-4, 1e-4, 1e-4], [1e-4] * 3)
    assert abs(wide.difference) > TOLERANCE_DB
    _, worst, error = checks([wide, *found(3)])
    assert worst.holds
    # … but that this says nothing is seen
    assert not error.holds
    assert error.value == wide.error
    assert error.why.startswith("mic; with a larger one 0.1 dB would not be told")


def test_standard_errors_that_resolve_the_tolerance_hold_and_the_widest_pass_is_said() -> None:
    """Two logarithms of ±2 % each: 10 / ln 10 · 0.02 · √2 / √15 = 0.032 dB, and with all eight scenes' quantile."""
    _, worst, error = checks(found())
    assert error.holds
    assert error.value == pytest.approx(0.032, rel=0.5)
    assert error.value is not None
    assert worst.high is not None
    assert f"{TOLERANCE_DB + worst.high * error.value:.2f} dB where they are largest" in worst.why


def test_one_view_has_no_error_and_no_verdict() -> None:
    single = agreement("lego", [1e-4], [2e-4], [1e-4])
    assert (single.error, single.excess()) == (None, None)
    for one in checks([single, *found(2)])[1:]:
        assert (one.value, one.holds) == (None, False)


def test_the_table_has_every_scene() -> None:
    (table,) = (one for one in judged(found(3)) if isinstance(one, Table))
    assert [row[0] for row in table.rows] == ["scene0", "scene1", "scene2"]
    assert all(len(row) == len(table.columns) for row in table.rows)


def test_scores_near_the_ceiling_are_called_so() -> None:
    scenes = [agreement(name, [1e-4] * 2, [1e-4] * 2, [1e-4] * 2) for name in ("lego", "mic", "ship")]
    (near,) = limited(scenes, {"lego": 39.5, "mic": 39.2, "ship": 30.0})
    assert "0.5 dB (lego) to 10.0 dB" in near
    assert "lego and mic are reference-limited" in near
    (far,) = limited(scenes, {"lego": 30.0})
    assert "none is reference-limited" in far
    assert next(limited(scenes, {})).startswith("No trained cell")


SCRIPT = """
import json, os, signal, sys
items = sys.argv[3:]
scalar = "--variant" in items
for item in items:
    if item.startswith("--"):
        break
    if item == "wrong":
        sys.exit(print("scenes: wrong: unknown scene", file=sys.stderr) or 2)
    if item == "broken":
        sys.exit("a bug")
    print(json.dumps({"item": item, "scene": item, "variant": "scalar" if scalar else "llvm"}), flush=True)
    if item == "deadly" and not scalar:
        os.kill(os.getpid(), signal.SIGKILL)
    print(json.dumps({"item": item, "scene": item, "variant": "scalar" if scalar else "llvm"}), flush=True)
"""


@pytest.fixture
def script(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "played.py").write_text(SCRIPT)
    monkeypatch.chdir(tmp_path)
    return "played"


def test_rows_are_sorted_by_what_was_asked_for(script: str) -> None:
    said: list[str] = []
    rows = noise_rows("scenes", ["lego", "mic"], ["--spp", "4"], said.append, script)
    assert {name: len(of) for name, of in rows.items()} == {"lego": 2, "mic": 2}
    assert said == ["rendering lego (1 of 2)", "rendering mic (2 of 2)"]


def test_a_process_that_a_signal_ends_is_gone_on_with(script: str) -> None:
    rows = noise_rows("scenes", ["lego", "deadly", "mic"], (), module=script)
    assert {name: [row["variant"] for row in of] for name, of in rows.items()} == {
        "lego": ["llvm", "llvm"], "deadly": ["scalar", "scalar"], "mic": ["scalar", "scalar"],
    }  # fmt: skip


def test_what_the_renderer_complains_about_is_passed_on(script: str) -> None:
    with pytest.raises(InputError, match=r"^wrong: unknown scene$"):
        noise_rows("scenes", ["lego", "wrong"], (), module=script)
    with pytest.raises(RuntimeError, match="exit code 1: a bug"):
        noise_rows("scenes", ["broken"], (), module=script)


def test_the_rows_are_what_the_renderer_prints() -> None:
    """The names that are read here are fields there."""
    from dataclasses import fields

    from scenes.rendering.noise_study import Again, Errors

    assert {"stored", "again", "halves", "spp", "variant", "scene"} <= {one.name for one in fields(Again)}
    assert {"spp", "seconds", "mse", "reference_mse", "reference_spp", "variant"} <= {
        one.name for one in fields(Errors)
    }
