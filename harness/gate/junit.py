"""Outcomes as JUnit XML, which CI systems read."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from harness.gate.catalog import KINDS
from harness.gate.outcome import Outcome, limits_in_words, line_of
from harness.json_record import write_whole


def write_junit(
    file: Path, outcomes: Sequence[Outcome], seconds: Mapping[str, float], replay: Mapping[str, str]
) -> None:
    """A suite a kind, a test case a gate. `seconds` by kind; `replay` by name of a failing gate."""
    failed = sum(one.status == "fail" for one in outcomes)
    top = ElementTree.Element("testsuites", tests=str(len(outcomes)), failures=str(failed), errors="0")
    for kind in KINDS:
        of_kind = [one for one in outcomes if one.gate.kind == kind]
        if not of_kind:
            continue
        bad = sum(one.status == "fail" for one in of_kind)
        took = seconds.get(kind, 0.0)
        suite = ElementTree.SubElement(
            top, "testsuite", name=f"gate.{kind}", tests=str(len(of_kind)), failures=str(bad), errors="0",
            time=f"{took:.3f}",
        )  # fmt: skip
        for one in of_kind:
            # a kind is measured as a whole: its time is shared evenly
            case = ElementTree.SubElement(
                suite, "testcase", classname=f"gate.{kind}", name=one.gate.name, time=f"{took / len(of_kind):.3f}"
            )
            if one.status == "fail":
                figure = "no figure" if one.figure is None else f"{one.figure:.6g} {one.gate.unit}".strip()
                message = f"{one.gate.what}: {figure}, {limits_in_words(one)}"
                failure = ElementTree.SubElement(case, "failure", type="gate", message=message)
                failure.text = f"{line_of(one)}\n{replay.get(one.gate.name, '')}\n"
    ElementTree.indent(top)
    write_whole(file, ElementTree.tostring(top, encoding="utf-8", xml_declaration=True))
