"""What a kind of gate is measured with, and how each of its gates comes to a check."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import wraps
from pathlib import Path

from harness.execution.progress import Progress
from harness.gate.gates import WIDER, Gate, Kind
from harness.gate.limits import LimitsFile, judge, unfit
from harness.gate.references import References
from harness.records.study import Answer, Check, Finding
from scenes.files.errors import InputError


@dataclass(frozen=True)
class GateContext:
    """One run of the gates, or one renewal."""

    gates: tuple[Gate, ...]
    limits: LimitsFile
    references: References
    """The references of the class of processor that is measured, or of another class."""
    of_class: str
    """The class that is measured."""
    limits_file: Path
    view_sets: Path
    out: Path
    scratch: Path
    """A folder on a disk that is removed after the run."""
    workers: int
    show: Progress

    @property
    def images(self) -> Path:
        """Return the folder of the stored mean and variance of the reference renders."""
        return self.limits_file.parent / "images"

    def of_kind(self, kind: Kind) -> dict[str, Gate]:
        """Return the gates of a kind that are asked for, by name."""
        return {gate.name: gate for gate in self.gates if gate.kind == kind}

    def wider(self, kind: Kind) -> float:
        """Return by how much the limits of a kind are wider than on the class of the references."""
        return 1.0 if self.references.name == self.of_class else WIDER[kind]


Measure = Callable[[GateContext], Iterator[Check]]


def complete(
    kind: Kind, answer: Callable[[dict[str, Check]], str] = lambda checks: ""
) -> Callable[[Measure], Callable[[GateContext], Iterator[Finding]]]:
    """Decorate the measurement of a kind so that each gate asked for yields one check: what is not measured fails.

    An error of ours in one kind costs its gates, not those of the others; `answer` puts its checks into a sentence.
    """

    def decorated(measure: Measure) -> Callable[[GateContext], Iterator[Finding]]:
        @wraps(measure)
        def findings(context: GateContext) -> Iterator[Finding]:
            asked = context.of_kind(kind)
            checks: dict[str, Check] = {}
            why = unfit(kind, context.references.kinds) if kind in WIDER else ""
            try:
                for check in () if why else measure(context):
                    checks[check.id] = check
                    yield check
            except (InputError, OSError):
                raise
            except Exception as error:
                why = f"{type(error).__name__}: {error}"
            for name in [name for name in asked if name not in checks]:
                checks[name] = judge(asked[name], [], why or "it was not measured")
                yield checks[name]
            if text := answer(checks):
                yield Answer(text)

        return findings

    return decorated
