"""What a reader of the paper might miss: what the run says of itself, and what the ledger could not judge and why."""

from reports.ledger import Claim
from reports.wording import UNTESTED, counted


def by_cause(found: list[Claim]) -> list[tuple[str, list[Claim]]]:
    """Claims that were not tested, gathered by what they need: `4 claims need …`, most first."""
    missing: dict[str, list[Claim]] = {}
    for claim in found:
        if claim.verdict == UNTESTED:
            missing.setdefault(claim.note, []).append(claim)
    gathered = sorted(missing.items(), key=lambda one: -len(one[1]))
    return [(f"{counted(len(some), 'claim')} {_agreeing(cause, len(some))}.", some) for cause, some in gathered]


def _agreeing(cause: str, many: int) -> str:
    """A cause begins with its verb in the plural."""
    return cause if many != 1 else cause.replace("need ", "needs ", 1).replace("are settings", "is a setting", 1)


def not_tested(said: list[str], found: list[Claim]) -> list[str]:
    """`said` by the run, then what the claims `found` that were not tested need."""
    return [*said, *(sentence for sentence, _ in by_cause(found))]


def in_short(said: list[str]) -> str:
    """How many things, and the first of them, which weighs most; nothing where all was tested."""
    if not said:
        return ""
    first = said[0].split(": ")[0].rstrip(".")
    first = f"the {first.removeprefix('The ')}" if first.startswith("The ") else first
    return f"{counted(len(said), 'thing')}{', among them ' if len(said) > 1 else ': '}{first}"
