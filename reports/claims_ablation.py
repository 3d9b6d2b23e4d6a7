"""Table 4: what each part adds to the row above it, on lego.

The factorial study trains every combination of the parts; its effects are taken where it lies beside the run, else the
run's own comparisons. Listing 2 is the paper's amplifier and is judged; what Eq. 4 gives stands beside.
"""

from harness.evidence_record import Effect, EvidenceRecord
from reports.claims_scores import PAIRED, interval_judged, tried
from reports.evidence_view import is_quick
from reports.judging import judge_gain, rounded_away
from reports.ledger import UNTESTED, Bench, Claim, Finding, Printed
from reports.selection import behind_difference
from reports.wording import counted, interval, signed

STUDY = "factorial"
TRUSTED_BY = (STUDY, "calibration")
"""Studies whose checks must hold before an effect may be believed."""
EQUATION_4 = {"nerf_phi_encoding_amplifier": "nerf_phi_encoding_equation4", "qnerf": "qnerf_theorem"}
"""The same row of Table 4 with the other reading of the amplifier."""


def added_part(bench: Bench, entry: Printed) -> Finding:
    """One row of Table 4 less the row above it."""
    scene, method, against, metric = (entry.of[name] for name in ("scene", "method", "against", "metric"))
    how = PAIRED.format(metric=metric.upper(), units="seed")
    if not isinstance(entry.printed, int | float):
        return Finding(UNTESTED, how)
    rounding = rounded_away(entry)
    effect = effect_of(bench.evidence, scene, method, against, metric)
    if effect is not None and bench.evidence is not None:
        study = bench.evidence.study(STUDY)
        pair = effect.simultaneous or effect.interval
        verdict = judge_gain(entry.printed, rounding, effect.difference, pair, effect.unpaired)
        lost = f"{counted(effect.unpaired, 'pair')} lost" if effect.unpaired else ""
        other = _other_reading(bench.evidence, scene, method, against, metric, entry.digits)
        note = "; ".join(filter(None, [other, lost, doubts(bench.evidence)]))
        return Finding(verdict, how, effect.difference, pair, study.scale if study else "", note)
    one = bench.records.comparison(scene, method, against, metric)
    if one is None or not tried(bench, one):
        note = f"{method} was not compared with {against} on {scene}: the factorial study does"
        return Finding(UNTESTED, how, note=note)
    pair = interval_judged(one)
    verdict = judge_gain(entry.printed, rounding, one.difference, pair, one.unpaired)
    lost = f"{counted(one.unpaired, 'pair')} lost" if one.unpaired else ""
    return Finding(verdict, how, one.difference, pair, note=lost, runs=behind_difference(one))


def doubts(evidence: EvidenceRecord) -> str:
    """What speaks against taking the study's effects as they stand; nothing where nothing does."""
    failed = [
        f"{sum(not check.holds for check in study.checks)} of {counted(len(study.checks), 'check')} of {name}"
        for name in TRUSTED_BY
        if (study := evidence.study(name)) and not all(check.holds for check in study.checks)
    ]
    parts = [] if evidence.finished else ["the evidence was not finished"]
    parts += [f"{' and '.join(failed)} did not hold"] if failed else []
    return "; ".join(parts)


def effect_of(evidence: EvidenceRecord | None, scene: str, method: str, against: str, metric: str) -> Effect | None:
    """At equal steps, from the factorial study; a quick one says nothing."""
    study = evidence.study(STUDY) if evidence and not is_quick(evidence) else None
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
    shown = f"{signed(one.difference, digits + 1)} {interval(one.simultaneous or one.interval, digits + 1)}".strip()
    return f"with the amplifier of Eq. 4: {shown} ({one.verdict})"


def untested(found: list[Claim]) -> list[str]:
    """What the ledger has left untested of the ablation, in a sentence; none where nothing was."""
    steps = [claim for claim in found if claim.kind == "gains" and "Table 4" in claim.source]
    missing = sum(claim.verdict == UNTESTED for claim in steps)
    if not missing:
        return []
    return [
        f"The ablation of Table 4: {missing} of its {counted(len(steps), 'step')} on lego; the factorial study of "
        "`nox -s evidence` trains every combination of the parts, and is judged where its record lies beside.",
    ]
