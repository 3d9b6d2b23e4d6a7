"""Every method of the catalogue conforms: a listed method is tested without further work."""

import pytest

from baselines.catalog import CATALOG
from harness.machine.device import use_threads
from harness.studies.conformance.method_checks import CHECKS, FIELD_CHECKS, LEARNER_CHECKS, meaning
from harness.studies.conformance.subject import Subject
from tests.harness.voxels import drjit_or_skip

NETWORKS = [name for name, method in CATALOG.items() if method.is_field]
UNLIKE = {(each.parts.amplifier, each.parts.quadrature) if each.parts else name: name for name, each in CATALOG.items()}
"""One method of each amplifier and rule, and each that is not made of parts: other encodings and skips are trained by
the same code, and `test_finished` trains and restores every method.
"""
LONG = ("two_passes", "derivatives")
"""The checks of fields that take seconds."""


@pytest.fixture(autouse=True)
def as_in_a_run() -> None:
    use_threads(1)


@pytest.mark.parametrize("check", [name for name in FIELD_CHECKS if name not in LONG])
@pytest.mark.parametrize("method", NETWORKS)
def test_fields_conform(method: str, check: str) -> None:
    FIELD_CHECKS[check](Subject(method))


@pytest.mark.parametrize("method", ["nerf", "qnerf", "hash_grid_phi"])
def test_gradients_are_derivatives(method: str) -> None:
    FIELD_CHECKS["derivatives"](Subject(method))


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize("check", [*LONG, *LEARNER_CHECKS])
@pytest.mark.parametrize("method", UNLIKE.values())
def test_learners_conform(method: str, check: str) -> None:
    if method in ("voxels_drjit", "ellipsoids"):
        drjit_or_skip()
    if not CATALOG[method].is_field and check in FIELD_CHECKS:
        pytest.skip("no torch field")
    CHECKS[check](Subject(method))


def test_every_method_has_a_title_and_every_check_a_meaning() -> None:
    assert all(method.title.strip() for method in CATALOG.values())
    assert all(map(meaning, CHECKS))
