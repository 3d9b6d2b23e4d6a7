"""The history of figures of `gate` and `speed`: a file of JSON lines, one per run, which is only appended to."""

from pathlib import Path

import msgspec
from msgspec import field

from harness.records.json_record import LARGEST_FILE, Record, plain
from scenes.files.errors import InputError


class PastRun(Record, frozen=True):
    """One run of a command, with its figures by id."""

    when: str
    """Its end, in UTC: `2026-11-24T15:36:02Z`."""
    command: str
    commit: str
    """The commit, followed by `-dirty` if files had changed since."""
    of_class: str
    """The class of the processor (`harness.machine.processor_class`)."""
    processor: str
    threads: int
    values: dict[str, float]
    units: dict[str, str] = field(default_factory=dict)
    """Map figure → its unit, if it has one."""

    @property
    def machine(self) -> str:
        """Return the machine, on which figures are comparable: `avx2, AMD EPYC, 2 threads`."""
        return f"{self.of_class}, {self.processor}, {self.threads} thread{'s' * (self.threads != 1)}"


def append(path: Path, run: PastRun) -> None:
    """Append a run as a new line, even after a truncated line; raises `OSError`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a+b") as file:
        if file.tell():
            file.seek(-1, 2)
            if file.read() != b"\n":
                file.write(b"\n")
        file.write(msgspec.json.encode(plain(run)) + b"\n")


def read_history(path: Path) -> tuple[list[PastRun], list[str]]:
    """Return the runs in their order, and a sentence for each invalid line, such as a truncated one. Raises
    `InputError` if the file does not exist or holds no run.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file; `python -m harness gate` and `nox -s speed` append to one (--history)")
    if (size := path.stat().st_size) > LARGEST_FILE:
        raise InputError(f"{path}: has {size} bytes, more than the {LARGEST_FILE} that are read; cut old lines off")
    runs, damaged = [], []
    for number, line in enumerate(path.read_bytes().splitlines(), 1):
        try:
            runs.append(msgspec.json.decode(line, type=PastRun))
        except msgspec.DecodeError as error:
            damaged.append(f"{path}, line {number} is left out: {error}.")
    if not runs:
        raise InputError(f"{path}: {damaged[0] if damaged else 'is empty'}; name a file that gate or speed appended to")
    return runs, damaged
