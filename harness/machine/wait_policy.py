"""How the threads of torch wait for each other: asleep, so that processor seconds are those of work.

A thread of OpenMP that has ended its part of an operation tests again and again whether the others have. Where other
programs use the cores, those others are not running, and the processor time of a training is mostly that of waiting.
The library reads the variable once, when torch is imported: it must be set before.
"""

from collections.abc import Mapping

VARIABLE = "OMP_WAIT_POLICY"
SPINS = "GOMP_SPINCOUNT"
"""GNU's own variable, the number of tests before a thread sleeps, which overrules the policy."""


def wait_policy(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variable for a process that trains: passive, unless `environment` has a value of the user's."""
    return {VARIABLE: environment.get(VARIABLE) or "PASSIVE"}


def waits_passively(environment: Mapping[str, str]) -> bool:
    """Return whether threads of a process that was started with `environment` sleep while they wait."""
    spins = environment.get(SPINS, "").strip()
    return spins == "0" if spins else environment.get(VARIABLE, "").strip().upper() == "PASSIVE"
