"""`python -m harness doctor`."""

import argparse
import json
import tempfile
from dataclasses import asdict
from pathlib import Path

from harness.command.options import Command, Options, flag, option, require_between, require_use, shared
from harness.execution.progress import Progress
from scenes.files.errors import InputError
from scenes.files.json_object import JsonObject

DOCTOR: Options = {
    "--json": flag("print one JSON list instead of lines"),
    "--device": option(
        "try this device: its steps against the processor's, its rates, and cells of the paper's setting (10 min)",
        choices=("cpu", "cuda"),
        default=None,
    ),
    "--minutes": option("with --device: minutes of training of the cells (default: 10); 0: none", "M", float),
    "--view-set": option("with --device: posed images to train on (default: lego is rendered)", "DIR", Path),
    "--out": option("with --device: JSON file to write (default: device.json)", "FILE", Path, default=None),
    **shared("--view-sets", "--quick"),
}


def run_doctor(options: argparse.Namespace, show: Progress) -> int:
    tries = options.device is not None
    require_use(options, "with --device", tries, "out", "view_set", "minutes", "quick")
    require_use(options, "without --device", not tries, "json")
    if tries:
        return try_device(options, show)
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


def try_device(options: argparse.Namespace, show: Progress) -> int:
    """Write the report of a device, section by section; exit code 3 if it does not do what the processor does."""
    from harness.machine.device import chosen_device
    from harness.records.json_record import write_json
    from harness.studies.devices.device_report import DeviceContext, faults, sections

    options.minutes = 10.0 if options.minutes is None else options.minutes
    require_between(options, minutes=(0.0, 600.0))
    device, out = chosen_device(options.device), options.out or Path("device.json")
    if out.exists() and not options.out:
        raise InputError(f"{out}: exists; name another --out")
    found: JsonObject = {}
    with tempfile.TemporaryDirectory(prefix="device-") as scratch:
        context = DeviceContext(
            device, options.minutes, options.view_set, options.view_sets, Path(scratch), options.quick, show
        )
        for name, content in sections(context):
            found[name] = content
            write_json(out, found)
            show.line(f"{name}: written to {out}")
    sentences = faults(found)
    for sentence in sentences:
        show.line(f"not as on the processor: {sentence}")
    return 3 if sentences else 0


COMMANDS = {
    "doctor": Command("show what this machine has, and how to get the rest", DOCTOR, run_doctor),
}
