"""How threads wait: a user's own choice stays, and is what a record says."""

import subprocess
import sys

import pytest

from harness.machine.wait_policy import wait_policy, waits_passively
from tests.harness.shell import ROOT


@pytest.mark.parametrize(
    ("given", "policy", "passive", "afterwards"),
    [
        ({}, "PASSIVE", False, True),
        ({"OMP_WAIT_POLICY": ""}, "PASSIVE", False, True),
        ({"OMP_WAIT_POLICY": "passive"}, "passive", True, True),
        ({"OMP_WAIT_POLICY": "ACTIVE"}, "ACTIVE", False, False),
        ({"GOMP_SPINCOUNT": "0"}, "PASSIVE", True, True),
        ({"GOMP_SPINCOUNT": "1000"}, "PASSIVE", False, False),
    ],
)
def test_threads_wait_passively_unless_the_user_says_otherwise(
    given: dict[str, str], policy: str, passive: bool, afterwards: bool
) -> None:
    assert wait_policy(given) == {"OMP_WAIT_POLICY": policy}
    assert waits_passively(given) is passive
    assert waits_passively({**given, **wait_policy(given)}) is afterwards


def test_the_command_sets_it_before_torch_is_imported() -> None:
    """The library reads it as it is loaded: nothing that the command imports first may load it."""
    code = "import sys, harness.command.main; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0
