"""One line of what was found. Standard library alone: where torch cannot be imported, that is what is to be told."""

from dataclasses import dataclass
from typing import Literal

Verdict = Literal["ok", "limited", "missing"]


@dataclass(frozen=True)
class Finding:
    what: str
    found: str
    verdict: Verdict = "ok"
    to_do: str = ""
    """Where the verdict is not ok."""
    needed: bool = False
    """Whether nothing works without it: `missing` then ends with exit code 2."""


def one_line(text: object) -> str:
    return " ".join(str(text).split())[:300]
