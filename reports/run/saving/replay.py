"""The command that trains a cell of a run again, with the same bits on the same kind of processor."""

import shlex

from harness.records.cells import CellRecord
from reports.data.load import Records
from reports.data.scale import value_at

DROPPED = {
    *("--scenes", "--methods", "--seeds", "--first-seed", "--out", "--resume", "--executor", "--workers", "--threads"),
    *("--device", "--precision", "--verify-omissions", "--tensorboard", "--no-serving", "--quiet", "--lpips"),
    *("--partial", "--keep-every", "--ray-address", "--job"),
}
"""The options that a cell does not depend on, or that its own record states; earlier versions had `--no-serving`."""


def replay(records: Records, cell: CellRecord) -> str:
    """Return the command for a shell; empty for a guest, whose budget is the measured time of another cell."""
    words = shlex.split(records.run.command)
    if "run" not in words or cell.method in records.run.guests:
        return ""
    kept: list[str] = []
    option, place = "", 0
    for word in words[words.index("run") + 1 :]:
        option, place = (word.partition("=")[0], 0) if word.startswith("--") else (option, place + 1)
        other_set = option == "--view-set" and place > 0 and records.scenes[place - 1 : place] != [cell.scene]
        if option not in DROPPED and not other_set:
            kept.append(word)
    own = ["--methods", cell.method, "--seeds", "1", "--first-seed", str(cell.seed)]
    if not {"--view-set", "--scene-file"} & {word.partition("=")[0] for word in kept}:
        own = ["--scenes", cell.scene, *own]
    own += ["--device", "cpu" if cell.provenance.get("device", "cpu") == "cpu" else "cuda"]
    known = {"--threads": cell.provenance.get("threads"), "--precision": value_at(cell.settings, "train", "precision")}
    own += [word for name, value in known.items() if value is not None for word in (name, str(value))]
    return shlex.join(["python", "-m", "harness", "run", *kept, *own])


def conditions(cell: CellRecord) -> str:
    """Return what else must be the same for the same bits: commit, kind of processor, versions."""
    origin = cell.provenance
    parts = [f"commit {origin['commit']}" if "commit" in origin else "", str(origin.get("processor", ""))]
    packages = origin.get("packages") or {}
    parts += [f"{name} {packages[name]}" for name in ("torch", "numba") if name in packages]
    return ", ".join(filter(None, parts))
