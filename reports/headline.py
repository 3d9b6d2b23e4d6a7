"""What came out, in plain words: against the baseline *and* against the bandwidth control, by steps and by time.

The verdicts are those of the run's comparisons; this module only finds the words. A gain over `nerf` that is gone
against `nerf_matched` (the same network with a bandwidth that reaches as far as φ) is called a bandwidth effect.
"""

from dataclasses import dataclass

from harness.records import Comparison
from reports.load import Records
from reports.wording import counted, interval, listed, number, signed

BASELINE = "nerf"
CONTROL = "nerf_matched"
FAVOURITE = "qnerf"
BUDGETS = (("steps", "equal steps"), ("seconds", "equal training time"))


@dataclass(frozen=True)
class Roles:
    """Who stands against whom."""

    baseline: str
    control: str | None
    contenders: list[str]
    """Every method that is put to the test, the one of the headline first."""


@dataclass(frozen=True)
class Duel:
    """One contender against one rival over all scenes, at equal steps and at equal time."""

    method: str
    against: str
    steps: Comparison | None
    seconds: Comparison | None


@dataclass(frozen=True)
class Headline:
    title: str
    sentences: list[str]
    duels: list[Duel]


def roles(records: Records) -> Roles:
    methods = records.methods
    baseline = BASELINE if BASELINE in methods else methods[0]
    control = CONTROL if CONTROL in methods and baseline != CONTROL else None
    others = [method for method in methods if method not in (baseline, control)]
    others.sort(key=lambda method: method != FAVOURITE)
    return Roles(baseline, control, others or [method for method in (control,) if method])


def duels(records: Records, scene: str = "all") -> list[Duel]:
    """Every contender against the baseline and against the control."""
    cast = roles(records)
    rivals = [rival for rival in (cast.baseline, cast.control) if rival is not None]
    pairs = [(method, rival) for method in cast.contenders for rival in rivals if method != rival]
    return [
        Duel(
            method,
            rival,
            records.comparison(scene, method, rival, budget="steps"),
            records.comparison(scene, method, rival, budget="seconds"),
        )
        for method, rival in pairs
    ]


def headline(records: Records) -> Headline:
    cast, fought = roles(records), duels(records)
    if not cast.contenders:
        return Headline(f"Only {cast.baseline} was run: there is nothing to compare it with", [], [])
    method = cast.contenders[0]
    of_method = [duel for duel in fought if duel.method == method]
    sentences = [sentence for name, words in BUDGETS for sentence in _numbers(of_method, name, words)]
    sentences += _bandwidth_sentence(records, cast, of_method)
    sentences += disagreements(records, method)
    return Headline(_title(cast, method, of_method), sentences, fought)


def title_of(method: str, baseline: str, control: str | None, vs_baseline: str | None, vs_control: str | None) -> str:
    """The one line that a reader takes home, from the two verdicts at equal steps."""
    if vs_baseline is None:
        return f"No comparison of {method} with {baseline} could be made"
    if vs_baseline == "better":
        return _title_of_a_gain(method, baseline, control, vs_control)
    against_control = {
        "better": f", though above {control}",
        "worse": f", and below {control}",
        "equivalent": f" and level with {control}",
        "inconclusive": f"; against {control} nothing is settled",
    }.get(vs_control or "", "")
    words = {
        "worse": f"{method} scores below {baseline}",
        "equivalent": f"{method} and {baseline} score the same within the margin",
        "inconclusive": f"This run cannot tell {method} from {baseline}",
    }[vs_baseline]
    return words + against_control


def _title_of_a_gain(method: str, baseline: str, control: str | None, vs_control: str | None) -> str:
    gain = f"The gain of {method} over {baseline}"
    if control == method:
        return f"{method} scores above {baseline}: bandwidth alone makes this difference"
    if control is None or vs_control is None:
        return f"{method} scores above {baseline}, but without a bandwidth control beside it this says little"
    return {
        "better": f"{method} scores above both {baseline} and {control}",
        "equivalent": f"{gain} is a bandwidth effect: {control} does as well",
        "worse": f"{gain} is a bandwidth effect: {control} does better still",
        "inconclusive": f"{gain} is not shown to be more than a bandwidth effect: {control} may do as well",
    }[vs_control]


def _title(cast: Roles, method: str, fought: list[Duel]) -> str:
    verdicts = {duel.against: duel.steps.verdict if duel.steps else None for duel in fought}
    vs_control = verdicts.get(cast.control) if cast.control else None
    return title_of(method, cast.baseline, cast.control, verdicts.get(cast.baseline), vs_control)


def _numbers(fought: list[Duel], budget: str, words: str) -> list[str]:
    """At equal steps, mean test PSNR of qnerf is 0.82 dB above nerf [..] and 0.05 dB below nerf_matched [..]."""
    parts = []
    for duel in fought:
        one = duel.steps if budget == "steps" else duel.seconds
        if one is not None and one.difference is not None:
            with_interval = f" {interval(one.interval)}" if one.interval else ""
            parts.append(f"{signed(one.difference)} dB{with_interval} against {duel.against} ({one.verdict})")
    return [f"At {words}, {fought[0].method} stands at {listed(parts)}."] if parts else []


def _bandwidth_sentence(records: Records, cast: Roles, fought: list[Duel]) -> list[str]:
    """What the control itself gains over the baseline, where it was run: the size of the bandwidth effect."""
    if cast.control is None:
        return [f"{CONTROL} was not run, so a difference cannot be told from an effect of bandwidth alone."]
    one = records.comparison("all", cast.control, cast.baseline)
    if one is None or one.difference is None or fought[0].method == cast.control:
        return []
    return [
        f"Changing the bandwidth alone ({cast.control} against {cast.baseline}) makes {signed(one.difference)} dB"
        f" {interval(one.interval)}".rstrip()
        + f" ({one.verdict})."
    ]


def disagreements(records: Records, method: str) -> list[str]:
    """Where the verdict at equal time is not the one at equal steps."""
    found = []
    for scene in ["all", *records.scenes]:
        for duel in duels(records, scene):
            if duel.method != method or duel.steps is None or duel.seconds is None:
                continue
            if duel.steps.verdict != duel.seconds.verdict:
                where = "over all scenes" if scene == "all" else f"on {scene}"
                found.append(f"{where} against {duel.against} ({duel.steps.verdict} → {duel.seconds.verdict})")
    both = any(one.budget == "seconds" for one in records.comparisons)
    if not found:
        return ["Equal steps and equal time lead to the same verdict everywhere."] if both else []
    if len(found) > 5:
        found = [*found[:5], counted(len(found) - 5, "more case")]
    return [f"Equal steps and equal time differ {listed(found)}."]


def smallest_detectable(records: Records) -> str:
    """The power of the run in a sentence, or nothing."""
    fought = [duel.steps for duel in headline(records).duels if duel.steps]
    sizes = [one.smallest_detectable for one in fought if one.smallest_detectable is not None]
    if not sizes:
        return ""
    return f"A true difference below {number(max(sizes))} dB could have gone unnoticed (power 80 %)."
