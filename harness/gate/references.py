"""The stored results, `gates/references.json`, which this code must reproduce on every processor."""

from typing import Annotated

from msgspec import Meta, field

from harness.gate.gates import Kind
from harness.gate.limits import SCHEMA, KindFacts
from harness.records.json_record import Record

Numbers = Annotated[list[float], Meta(min_length=1)]


class Course(Record, frozen=True):
    losses: Numbers
    """The loss before each step."""
    renders: dict[str, Numbers]
    """Number of steps → red, green, blue and depth of some pixels of a test view."""


Courses = dict[str, dict[str, Course]]
"""Precision → start → its record."""


class Quotients(Record, frozen=True):
    facts: KindFacts
    gates: dict[str, Numbers]
    """Gate → one quotient per process."""


class References(Record, frozen=True):
    kinds: dict[Kind, KindFacts] = field(default_factory=dict)
    profiles: dict[str, object] = field(default_factory=dict)
    courses: Courses = field(default_factory=dict)
    cells: dict[str, dict[str, Numbers]] = field(default_factory=dict)
    """"scene/method/seed" → score → one value for each draw of the rounding, or a single one."""
    statistics: dict[str, Numbers] = field(default_factory=dict)
    """Comparison of the cells above → its difference and the ends of its intervals."""
    speed: dict[str, Quotients] = field(default_factory=dict)
    schema: int = SCHEMA


REFERENCES_FILE = "references.json"
