"""How threads wait: a user's choice stays, and is recorded."""

import pytest

from harness.machine.wait_policy import wait_policy, waits_passively


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
