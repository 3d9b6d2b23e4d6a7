"""`python -m harness doctor`."""

import argparse
import json
from dataclasses import asdict

from harness.command.options import Command, Options, flag
from harness.execution.progress import Progress

DOCTOR: Options = {"--json": flag("print one JSON list instead of lines")}


def run_doctor(options: argparse.Namespace, show: Progress) -> int:
    from harness.machine.doctor import findings

    known = []
    for finding in findings():
        known.append(finding)
        if not options.json:
            show.line(f"{finding.verdict:8} {finding.what}: {finding.found}")
            if finding.verdict != "ok":
                show.line(f"         → {finding.to_do}")
    lacking = [finding.what for finding in known if finding.verdict == "missing" and finding.needed]
    if options.json:
        show.line(json.dumps([asdict(finding) for finding in known], indent=2, ensure_ascii=False))
    else:
        show.line(f"missing, and needed: {', '.join(lacking)}" if lacking else "nothing that is needed is missing")
    return 2 if lacking else 0


COMMANDS = {
    "doctor": Command("show what this machine has, and how to get the rest", DOCTOR, run_doctor),
}
