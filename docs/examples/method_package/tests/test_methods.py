"""Run with the harness's checkout on the path: PYTHONPATH=/path/to/radiance-verdict python -m pytest"""

import pytest

from harness.studies.conformance.method_checks import conformance
from harness.studies.conformance.subject import Subject


@pytest.mark.parametrize("method", ["nerf_base3", "blobs", "voxel_grid"])
def test_conforms(method: str) -> None:
    broken = [outcome for outcome in conformance(Subject(method)) if outcome.verdict == "broken"]
    assert broken == []
