"""The context in which a kind of gates is measured, and the decorator that gives each of them a check."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import wraps
from pathlib import Path

from harness.gate.gates import Gate, Kind
from harness.gate.limits import LimitsFile, judge, unfit
from harness.gate.references import Courses, References
from harness.machine.processor_class import class_here
from harness.records.study import Answer, Check, Finding
from harness.studies.framework import StudyContext
from scenes.files.errors import InputError


@dataclass(frozen=True)
class GateContext(StudyContext):
    gates: tuple[Gate, ...]
    limits: LimitsFile
    references: References
    limits_file: Path
    first_steps: Callable[[], Courses]
    """Trains the first steps, once per run: `changed` compares them, and `worse` depends on whether they changed."""

    def settings(self) -> dict[str, object]:
        return {"class": class_here(), "gates": [gate.name for gate in self.gates]}

    @property
    def images(self) -> Path:
        """Return the folder of the stored mean and variance of the reference renders."""
        return self.limits_file.parent / "images"

    def of_kind(self, kind: Kind) -> dict[str, Gate]:
        return {gate.name: gate for gate in self.gates if gate.kind == kind}


REFERENCED: tuple[Kind, ...] = ("changed", "worse")
"""The kinds whose references hold for every processor."""
Measure = Callable[[GateContext], Iterable[Finding]]


def complete(
    kind: Kind, answer: Callable[[dict[str, Check]], str] = lambda checks: ""
) -> Callable[[Measure], Callable[[GateContext], Iterator[Finding]]]:
    """Decorate the measurement of a kind so that each chosen gate yields one check: a gate without a measurement fails,
    and a program error fails only this kind's gates. `answer` makes a sentence of the checks, which comes first.
    """

    def decorated(measure: Measure) -> Callable[[GateContext], Iterator[Finding]]:
        @wraps(measure)
        def findings(context: GateContext) -> Iterator[Finding]:
            chosen = context.of_kind(kind)
            checks: dict[str, Check] = {}
            why = unfit(kind, context.references.kinds) if kind in REFERENCED else ""
            others: list[Finding] = []
            try:
                for finding in () if why else measure(context):
                    if isinstance(finding, Check):
                        checks[finding.id] = finding
                        yield finding
                    else:
                        others.append(finding)
            except (InputError, OSError):
                raise
            except Exception as error:
                why = f"{type(error).__name__}: {error}"
            for name in [name for name in chosen if name not in checks]:
                checks[name] = judge(chosen[name], [], why or "it was not measured")
                yield checks[name]
            if text := answer(checks):
                yield Answer(text)
            yield from others

        return findings

    return decorated
