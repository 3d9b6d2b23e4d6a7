"""A judgement in words and as lines of a terminal; read by reports as well."""

from collections import Counter
from collections.abc import Iterator

from harness.judge.record import JudgementRecord, Ranking, Suspect, changed_pairs


def headline(record: JudgementRecord) -> str:
    """What the table says, as given."""
    return f"{len(record.given.places)} methods on {len(record.scenes)} scenes: {told(record, record.given)}"


def told(record: JudgementRecord, ranking: Ranking) -> str:
    """How many pairs are told apart."""
    if record.baseline is not None:
        verdicts = Counter[str](pair.verdict for pair in ranking.pairs)
        words = {"better": "better", "worse": "worse", "equivalent": "equivalent", "inconclusive": "not told apart"}
        known = [f"{verdicts[name]} {said}" for name, said in words.items() if verdicts[name]]
        return f"against {record.baseline} {', '.join(known)}"
    apart, every = (sum(pair.told_apart for pair in pairs) for pairs in (ranking.neighbours, ranking.pairs))
    many, all_many = len(ranking.neighbours), len(ranking.pairs)
    if every == all_many:
        return "all told apart from each other"
    if every == 0:
        return "no two told apart"
    return f"{apart or 'none'} of {many} neighbouring pairs told apart, {every} of all {all_many} pairs"


def number(record: JudgementRecord, value: float | None, sign: str = "") -> str:
    """With two decimals of dB, and four significant digits of what else there is."""
    if value is None:
        return "–"
    text = format(value, f"{sign}.2f" if record.unit else f"{sign}#.4g")
    return text.replace("-", "−")


def suspect_line(record: JudgementRecord, one: Suspect) -> str:
    unit = f" {record.unit}" if record.unit else ""
    seed = f", seed {one.seed}" if one.seed else ""
    return (
        f"{one.method} on {one.scene}{seed}: {number(record, one.value)}{unit} where method and scene let one expect "
        f"{number(record, one.expected)}{unit}"
    )


def without_line(record: JudgementRecord) -> str:
    """What becomes of the verdicts without the suspect results."""
    if record.without_suspects is None:
        return ""
    many = len(changed_pairs(record))
    changes = f"{many or 'no'} verdict{'' if many == 1 else 's'} change{'s' if many == 1 else ''}"
    return (
        f"Without {'it' if len(record.suspects) == 1 else 'them'}: {told(record, record.without_suspects)}; {changes}."
    )


def lines(record: JudgementRecord) -> Iterator[str]:
    """The table of a terminal, what is suspect, what is missing, and what a reader must know."""
    yield headline(record)
    last = "groups" if record.baseline is None else f"against {record.baseline}"
    rows = [("method", f"mean {record.metric}", "scenes", last)]
    for one in record.given.places:
        said = shown_groups(one.groups) if record.baseline is None else _against(record, one.method)
        rows.append((one.method, number(record, one.mean), str(one.scenes), said))
    widths = [max(len(row[place]) for row in rows) for place in range(3)]
    for name, mean, scenes, said in rows:
        yield f"  {name:{widths[0]}}  {mean:>{widths[1]}}  {scenes:>{widths[2]}}  {said}"
    if record.baseline is None:
        yield "No two methods of a group are told apart."
    for suspect in record.suspects[:10]:
        yield f"suspect: {suspect_line(record, suspect)}"
    if len(record.suspects) > 10:
        yield f"suspect: {len(record.suspects) - 10} more"
    if record.without_suspects is not None:
        yield without_line(record)
    if record.missing:
        yield missing_line(record)
    yield from record.notes


def missing_line(record: JudgementRecord) -> str:
    shown = "; ".join(record.missing[:5]) + (f"; {len(record.missing) - 5} more" if len(record.missing) > 5 else "")
    return f"Without a result ({len(record.missing)}): {shown}. Pairs are compared on the scenes that both have."


def shown_groups(groups: list[int]) -> str:
    """`2`, or `2–4`: a method's groups follow each other."""
    return f"{groups[0]}" if len(groups) == 1 else f"{groups[0]}–{groups[-1]}" if groups else ""


def _against(record: JudgementRecord, method: str) -> str:
    pair = next((pair for pair in record.given.pairs if pair.method == method), None)
    if pair is None:
        return "–"
    ends = pair.scenes_like_these.simultaneous if pair.scenes_like_these else None
    within = f" [{', '.join(number(record, end, '+') for end in ends)}]" if ends else ""
    return f"{number(record, pair.difference, '+')}{within} {pair.verdict}"
