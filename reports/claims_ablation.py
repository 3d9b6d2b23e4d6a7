"""Table 4: what each part adds to the row above it, on lego.

The factorial study trains every combination of the parts; its effects are taken where it lies beside the run, else the
run's own comparisons. Listing 2 is the paper's amplifier and is judged; what Eq. 4 gives stands beside.
"""

from harness.evidence_record import Effect, EvidenceRecord
from reports.claims_scores import PAIRED, interval_judged
from reports.judging import half_unit, judge_gain
from reports.ledger import UNTESTED, Bench, Finding, Printed
from reports.wording import interval, signed

STUDY = "factorial"
EQUATION_4 = {"nerf_phi_encoding_amplifier": "nerf_phi_encoding_equation4", "qnerf": "qnerf_theorem"}
"""The same row of Table 4 with the other reading of the amplifier."""


def added_part(bench: Bench, entry: Printed) -> Finding:
    """One row of Table 4 less the row above it."""
    scene, method, against, metric = (entry.of[name] for name in ("scene", "method", "against", "metric"))
    how = PAIRED.format(metric=metric.upper(), units="seed")
    if not isinstance(entry.printed, int | float):
        return Finding(UNTESTED, how)
    rounding = half_unit(entry.printed, entry.unit)
    effect = effect_of(bench.evidence, scene, method, against, metric)
    if effect is not None and bench.evidence is not None:
        study = bench.evidence.study(STUDY)
        pair = effect.simultaneous or effect.interval
        verdict = judge_gain(entry.printed, rounding, effect.difference, pair, effect.left_aside)
        note = _other_reading(bench.evidence, scene, method, against, metric, entry.digits)
        return Finding(verdict, how, effect.difference, pair, study.scale if study else "", note)
    one = bench.records.comparison(scene, method, against, metric)
    if one is None:
        note = f"{method} was not compared with {against} on {scene}: the factorial study does"
        return Finding(UNTESTED, how, note=note)
    pair = interval_judged(one)
    verdict = judge_gain(entry.printed, rounding, one.difference, pair, one.left_aside)
    return Finding(verdict, how, one.difference, pair)


def effect_of(evidence: EvidenceRecord | None, scene: str, method: str, against: str, metric: str) -> Effect | None:
    """At equal steps, from the factorial study."""
    study = evidence.study(STUDY) if evidence else None
    wanted = (method, against, scene, metric, "steps")
    found = (one for one in (study.effects if study else []))
    return next((one for one in found if (one.name, one.against, one.scene, one.metric, one.budget) == wanted), None)


def _other_reading(evidence: EvidenceRecord, scene: str, method: str, against: str, metric: str, digits: int) -> str:
    """The same with the amplifier of Eq. 4, where the row has an amplifier."""
    if method not in EQUATION_4:
        return ""
    one = effect_of(evidence, scene, EQUATION_4[method], EQUATION_4.get(against, against), metric)
    if one is None or one.difference is None:
        return ""
    shown = f"{signed(one.difference, digits + 1)} {interval(one.interval, digits + 1)}".strip()
    return f"with the amplifier of Eq. 4: {shown} ({one.verdict})"
