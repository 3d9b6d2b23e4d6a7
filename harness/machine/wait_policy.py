"""The wait policy of torch's threads: they sleep while they wait, so that core seconds measure work.

By default an OpenMP thread that has finished its part of an operation spins until the others have. Where other programs
use the cores, the others are not running, and most of a training's processor time is waiting. The library reads the
variable once, when torch is imported: it must be set before.
"""

from collections.abc import Mapping

VARIABLE = "OMP_WAIT_POLICY"
SPINS = "GOMP_SPINCOUNT"
"""GNU's variable: the number of spins before a thread sleeps, which overrules the policy."""


def wait_policy(environment: Mapping[str, str]) -> dict[str, str]:
    """Return the variable for a process that trains: the user's value in `environment`, else passive."""
    return {VARIABLE: environment.get(VARIABLE) or "PASSIVE"}


def waits_passively(environment: Mapping[str, str]) -> bool:
    """Return whether threads of a process that was started with `environment` sleep while they wait."""
    spins = environment.get(SPINS, "").strip()
    return spins == "0" if spins else environment.get(VARIABLE, "").strip().upper() == "PASSIVE"
