"""`doctor --device` tries a device against the processor, and writes each section as soon as it is measured."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from harness.command.main import main
from harness.studies.devices import device_report
from harness.studies.devices.device_report import CELLS, NETWORKS, faults
from tests.harness.patching import changed
from tests.harness.shell import refused


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return the report of the processor, which is the device, on fewer methods."""
    out = tmp_path_factory.mktemp("device") / "device.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(device_report, "NETWORKS", ("nerf", "qnerf"))
        assert main(["doctor", "--device", "cpu", "--quick", "--minutes", "0.01", "--out", str(out)]) == 0
    found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    return found


@pytest.mark.slow
def test_the_processor_agrees_with_itself(report: dict[str, Any]) -> None:
    assert list(report) == ["facts", "methods", "bits", "rates", "cells"]
    assert {"device", "torch_build", "commit", "packages"} <= set(report["facts"])
    for row in report["methods"].values():
        assert (row["agrees"], row["apart"], row["first_apart"]) == (True, 0.0, 0.0)
        assert row["changed"] > 1e-3, "the steps must change something to compare"
    assert report["bits"] == {"equal": True, "largest_difference": 0.0, "steps": 4}
    assert faults(report) == []


@pytest.mark.slow
def test_rates_count_what_was_evaluated_and_cells_have_curves(report: dict[str, Any]) -> None:
    rates = report["rates"]
    for name in ("nerf.bfloat16", "qnerf.bfloat16", "nerf.float32"):
        row = rates[name]
        assert row["samples_per_second"] == pytest.approx(256 * (16 + 16 + 8) / (row["milliseconds"] / 1e3))
        assert row["share_of_matrix_rate"] > 0.0
    assert rates["plain_torch.bfloat16"]["samples_per_second"] > 0.0
    assert set(report["cells"]) > set(CELLS)
    for method in CELLS:
        cell = report["cells"][method]
        assert (cell["status"], cell["curve"][-1]["step"]) == ("done", cell["steps"])


def test_every_network_of_the_catalogue_is_tried() -> None:
    assert {"nerf", "nerf_matched", "qnerf", "qnerf_repaired", "qnerf_listing4"} < set(NETWORKS)


def test_a_device_that_differs_is_named_and_ends_with_exit_code_3(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def sections(context: object) -> Iterator[tuple[str, dict[str, Any]]]:
        yield "methods", {"nerf": {"agrees": False, "why": None}, "qnerf": {"agrees": False, "why": "no kernel"}}
        yield "bits", {"equal": False}

    monkeypatch.setattr(device_report, "sections", sections)
    assert main(["doctor", "--device", "cpu", "--out", str(tmp_path / "device.json")]) == 3
    said = "".join(capsys.readouterr())
    for sentence in ("nerf: its picture differs", "qnerf: no kernel", "two equal runs have other bits"):
        assert f"not as on the processor: {sentence}" in said


def test_what_fails_is_a_sentence_and_the_other_sections_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(context: object) -> dict[str, Any]:
        raise ValueError(f"no memory in {Path.home()}/a")

    for name in ("facts", "equal_runs", "cells"):
        monkeypatch.setattr(device_report, name, lambda context: {})
    monkeypatch.setattr(device_report, "NETWORKS", ())
    monkeypatch.setattr(device_report, "rates", broken)
    found = dict(device_report.sections(type("Context", (), {"minutes": 1.0})()))  # type: ignore[arg-type]
    assert found["rates"] == {"failed": "ValueError: no memory in ~/a"}
    assert list(found) == ["facts", "methods", "bits", "rates", "cells"]
    found |= {"bits": {"equal": True}, "cells": {"nerf": {"status": "error", "reason": "no kernel"}}}
    assert faults(found) == ["rates: ValueError: no memory in ~/a", "cell of nerf: no kernel"]


@pytest.mark.slow
def test_pictures_that_are_too_far_apart_do_not_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    import torch

    seen = iter([False, False, False, True])  # the last is the device's, trained

    @torch.no_grad()
    def other_at_last(learner: Any, *_: object) -> Any:
        if next(seen):
            for field in (learner.coarse, learner.fine):
                field.colour_net[-1].bias += 3.0
        return learner

    changed(monkeypatch, device_report, "_trained", other_at_last)
    context: Any = type("Context", (), {"device": torch.device("cpu")})()
    assert not device_report.against_the_processor(context, "nerf")["agrees"]


def test_a_device_that_is_not_there_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--device cuda" in refused(capsys, "--device", "cuda", command="doctor")
