"""`python -m harness view` as a user types it."""

import shutil
import signal
import socket
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from harness.command.look_commands import hosts_of
from tests.harness.shell import ROOT, refused


def said(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    return refused(capsys, *arguments, "--no-browser", command="view")


@pytest.mark.parametrize(
    ("options", "what"),
    [
        (["--scene", "nothing"], "--scene: unknown 'nothing'"), (["--methods", "nothing"], "nothing"),
        (["--methods", "nerf_matched"], "no checkpoint of nerf_matched with seed 0 on ball"),
        (["--seed", "1"], "--seed 1: the run has 0"), (["--port", "70000"], "--port 70000"),
        (["--threads", "0"], "--threads 0"), (["--resolution", "100000"], "--resolution 100000"),
        (["--host", "203.0.113.9", "--port", "0"], "not an address of this machine"),
        (["--host", "no such host", "--port", "0"], "no such host"),
    ],
)  # fmt: skip
def test_what_cannot_be_shown(options: list[str], what: str, out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert what in said(capsys, out, *options)


def test_a_run_that_is_missing_or_damaged_is_said(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for folder in (out / "records", out / "nothing"):
        assert "holds no run" in said(capsys, folder)
    shutil.rmtree(out / "checkpoints")
    assert "nothing to show" in said(capsys, out)
    (out / "records/run.json").write_text("{")
    assert "run.json" in said(capsys, out)


def test_a_port_in_use_is_said(out: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert f"--port {port}: another program listens there; --port 0" in said(capsys, out, "--port", str(port))


def test_only_names_of_this_machine_are_answered_to() -> None:
    for host in ("127.0.0.1", "localhost", "::1"):
        assert hosts_of(host) == ["127.0.0.1", "[::1]", "localhost"]
    everywhere = hosts_of("0.0.0.0")
    assert socket.gethostname().lower() in everywhere
    assert not [name for name in everywhere if "*" in name or not name]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("host", "stop", "is_asked"),
    [("127.0.0.1", signal.SIGINT, False), ("127.0.0.1", signal.SIGINT, True), ("0.0.0.0", signal.SIGTERM, True)],
)
def test_it_serves_until_it_is_stopped(out: Path, host: str, stop: signal.Signals, is_asked: bool) -> None:
    """An interrupt as soon as the address is there ends it in order."""
    command = [sys.executable, "-m", "harness", "view", str(out), "--port", "0", "--no-browser", "--host", host]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    line = process.stdout.readline()
    assert "http://" in line
    try:
        if is_asked:
            port = int(line.partition("http://")[2].partition("/")[0].rpartition(":")[2])
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/run.json", timeout=60) as answer:
                assert b'"ball"' in answer.read()
    finally:
        process.send_signal(stop)
        _, errors = process.communicate(timeout=60)
    if host == "127.0.0.1":
        assert (process.returncode, errors) == (0, "")
    else:
        assert errors.startswith("warning: --host 0.0.0.0: everyone who reaches this machine")
        assert "Traceback" not in errors
        assert process.returncode in (0, -signal.SIGTERM)
