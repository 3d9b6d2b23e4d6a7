"""A short version of `nox -s endurance`."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.endurance.runs import ROOT


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(os, "fork"), reason="runs are forked")
def test_a_few_kills_and_one_damage_of_each_kind_lose_nothing(tmp_path: Path) -> None:
    options = ["--kills", "3", "--typed-kills", "1", "--seed", "1", "--brief", "--scratch"]
    call = [sys.executable, "-m", "tests.endurance", *options, tmp_path / "s"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, f"{done.stdout[-3000:]} {done.stderr[-2000:]}"
    assert "\n3 forked kills of " in done.stdout
    assert "\n1 typed kills of " in done.stdout
    assert done.stdout.endswith("0 wrong\n")
