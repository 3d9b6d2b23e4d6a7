"""Figures in sentences."""

import pytest

from harness.evidence.wording import amount, listed, short, told
from harness.evidence_record import Effect, Verdict


def effect(difference: float | None, ends: tuple[float, float] | None, verdict: Verdict, **changes: object) -> Effect:
    facts = {"metric": "psnr", "family": 1, "unpaired": 0, **changes}
    return Effect(
        "a", "b", "all", str(facts["metric"]), "steps", difference, ends, ends, int(str(facts["family"])), verdict,
        None, 3, int(str(facts["unpaired"])),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("value", "metric", "said"),
    [
        (0.814, "psnr", "+0.81 dB"),
        (-3.0, "psnr", "−3.00 dB"),
        (-0.001, "psnr", "0.00 dB"),
        (0.0123, "ssim", "+0.012"),
        (None, "psnr", "no figure"),
    ],
)
def test_amounts(value: float | None, metric: str, said: str) -> None:
    assert amount(value, metric) == said


def test_a_score_has_no_sign() -> None:
    assert amount(24.1, "psnr", sign=False) == "24.10 dB"


def test_effects_with_their_intervals() -> None:
    assert told(effect(0.8, (0.5, 1.1), "better")) == "+0.80 dB (95 % interval +0.50 to +1.10: better)"
    assert told(effect(0.0, (-0.1, 0.1), "equivalent", family=3)) == (
        "0.00 dB (95 % interval, 3 together, −0.10 to +0.10: within ±0.2 dB)"
    )
    assert told(effect(-0.3, (-0.5, -0.1), "worse"), gain=False).endswith("−0.50 to −0.10: below 0)")
    assert told(effect(0.3, (0.1, 0.5), "better"), gain=False).endswith("above 0)")
    assert told(effect(0.3, (-0.1, 0.7), "inconclusive", unpaired=1)) == (
        "+0.30 dB (95 % interval −0.10 to +0.70: not settled, 1 of 4 pairs without a score)"
    )
    assert told(effect(None, None, "inconclusive", unpaired=3)) == (
        "no figure (no interval, 3 of 6 pairs without a score)"
    )


def test_effects_in_a_cell_of_a_table() -> None:
    assert short(effect(0.8, (-0.5, 1.1), "inconclusive")) == "+0.80 [−0.50, +1.10]"
    assert short(effect(0.8, None, "inconclusive")) == "+0.80"
    assert short(effect(None, None, "inconclusive")) == "no figure"


def test_lists() -> None:
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"]) == "a, b and c"
    assert listed(iter(["a", "b"])) == "a and b"
