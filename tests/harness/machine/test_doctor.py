"""The findings of `doctor` on simulated machines, and on this one."""

import json
import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import pytest

from harness.command.main import main
from harness.machine import doctor
from harness.machine.doctor import Finding
from tests.harness.shell import ROOT


@pytest.fixture
def probes(monkeypatch: pytest.MonkeyPatch) -> dict[str, object]:
    table: dict[str, object] = {}
    monkeypatch.setattr(doctor, "PROBES", table)
    return table


def test_each_finding_has_a_line_with_its_remedy_and_a_missing_need_is_exit_code_2(
    probes: dict[str, object], capsys: pytest.CaptureFixture[str]
) -> None:
    probes["first"] = lambda: [Finding("disk", "1 GB", "limited", "make room"), Finding("ray", "none", "missing", "do")]
    assert main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines[:2]] == [["limited", "disk:", "1", "GB"], ["→", "make", "room"]]
    probes["second"] = lambda: [Finding("torch", "not installed", "missing", "install it", needed=True)]
    assert main(["doctor"]) == 2
    assert capsys.readouterr().out.endswith("\nmissing, and needed: torch\n")


def test_a_probe_that_fails_is_a_finding(probes: dict[str, object], capsys: pytest.CaptureFixture[str]) -> None:
    def broken() -> list[Finding]:
        raise ImportError("libtorch.so:\nno such file")

    probes["torch"] = broken
    assert main(["doctor", "--json"]) == 2
    (finding,) = json.loads(capsys.readouterr().out)
    assert (finding["found"], finding["needed"]) == ("ImportError: libtorch.so: no such file", True)


def test_memory_is_the_least_of_machine_and_container(tmp_path: Path) -> None:
    meminfo = tmp_path / "meminfo"
    meminfo.write_text("MemTotal:       4000 kB\nMemFree: 1 kB\n")
    groups, job = tmp_path / "own", tmp_path / "slurm" / "job"
    groups.write_text("0::/slurm/job\n")
    job.mkdir(parents=True)
    assert doctor.memory_bytes(tmp_path, groups, meminfo) == 4_096_000
    for folder, text, least in ((tmp_path, "max", 4_096_000), (job, "2000000", 2_000_000), (tmp_path, "1000000", 1e6)):
        (folder / "memory.max").write_text(text)
        assert doctor.memory_bytes(tmp_path, groups, meminfo) == least
    assert doctor.memory_bytes(tmp_path / "none", groups, tmp_path / "none") is None


@pytest.mark.parametrize(
    ("gigabytes", "verdict"), [(None, "limited"), (1.0, "missing"), (3.5, "limited"), (64.0, "ok")]
)
def test_memory_is_judged_by_workers(monkeypatch: pytest.MonkeyPatch, gigabytes: float | None, verdict: str) -> None:
    monkeypatch.setattr(doctor, "memory_bytes", lambda: None if gigabytes is None else int(gigabytes * 1e9))
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {0, 1, 2, 3}, raising=False)
    (finding,) = doctor.memory_findings()
    assert finding.verdict == verdict
    if gigabytes == 3.5:
        assert "--workers 2" in finding.to_do


@pytest.mark.parametrize(("free", "verdict"), [(0.1, "missing"), (1.0, "limited"), (50.0, "ok")])
def test_the_disk_is_that_of_the_output_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: float, verdict: str
) -> None:
    usage = {tmp_path: SimpleNamespace(free=int(free * 1e9))}
    monkeypatch.setattr("shutil.disk_usage", usage.__getitem__)
    (finding,) = doctor.disk_findings(tmp_path / "not" / "yet")
    assert finding.verdict == verdict


def test_packages_are_held_to_the_tested_ranges(monkeypatch: pytest.MonkeyPatch) -> None:
    here = {"torch": "2.15.0+cpu", "numpy": "1.0"}
    tested = ["torch>=2.9,<2.15.1", "numpy>=2.3,<2.5", "no-such-package>=1.16,<1.18"]
    monkeypatch.setattr(doctor, "version", lambda name: here.get(name) or version(name))
    monkeypatch.setattr(doctor, "_project", lambda: {"project": {"dependencies": tested}})
    first, *odd = doctor.package_findings()
    assert first.found == "1 of 3 as tested", "2.15 is more than 2.9, and a build's local version is no other version"
    assert [(finding.what, finding.verdict, finding.needed) for finding in odd] == [
        ("numpy", "limited", False),
        ("no-such-package", "missing", True),
    ]


@pytest.mark.slow
def test_this_machine() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "harness", "doctor", "--json"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    findings = {finding["what"]: finding for finding in json.loads(done.stdout)}
    assert findings["Mitsuba scalar_rgb"]["found"] == "renders"
    assert findings["torch"]["verdict"] == "ok"
    assert all(finding["to_do"] for finding in findings.values() if finding["verdict"] != "ok")
