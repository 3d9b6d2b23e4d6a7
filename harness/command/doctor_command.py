"""`python -m harness doctor`: its options, and what they do."""

import argparse
import json
from dataclasses import asdict
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from harness.execution.progress import Progress


def add_doctor_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("--json", action="store_true", help="one JSON list instead of lines")


def run_doctor(options: argparse.Namespace, show: "Progress") -> int:
    """Return 0, or 2 if something is missing that nothing works without."""
    from harness.machine.doctor import findings

    found = []
    for finding in findings():
        found.append(finding)
        if not options.json:
            show.line(f"{finding.verdict:8} {finding.what}: {finding.found}")
            if finding.verdict != "ok":
                show.line(f"         → {finding.to_do}")
    if options.json:
        show.line(json.dumps([asdict(finding) for finding in found], indent=2, ensure_ascii=False))
    lacking = [finding.what for finding in found if finding.verdict == "missing" and finding.needed]
    if not options.json:
        show.line(f"missing, and needed: {', '.join(lacking)}" if lacking else "everything that is needed is there")
    return 2 if lacking else 0
