"""What a reader of the paper might miss: what the run says of itself, and what the ledger could not judge for want of a
record beside it.
"""

from reports import claims_ablation, claims_serving
from reports.ledger import Claim
from reports.wording import counted

KNOWN_HERE = ("The ablation of Table 4", "View caching and attention-prioritised rendering")
"""How sentences of older runs begin, which could not know what would lie beside them."""


def not_tested(said: list[str], found: list[Claim]) -> list[str]:
    """`said` by the run, then what of the claims `found` was left untested of ablation and serving, if anything."""
    kept = [one for one in said if not one.startswith(KNOWN_HERE)]
    return [*kept, *claims_ablation.untested(found), *claims_serving.untested(found)]


def in_short(said: list[str]) -> str:
    """How many things, and the first of them, which weighs most; nothing where all was tested."""
    if not said:
        return ""
    first = said[0].split(": ")[0].rstrip(".")
    first = f"the {first.removeprefix('The ')}" if first.startswith("The ") else first
    return f"{counted(len(said), 'thing')}{', among them ' if len(said) > 1 else ': '}{first}"
