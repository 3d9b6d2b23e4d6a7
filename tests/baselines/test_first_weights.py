"""First weights, and what the paper's operators do to calls: what is said of ours beside the conformance checks."""

import math
from dataclasses import replace

import pytest
import torch

from baselines.field import NetworkField
from baselines.methods.qnerf import QNERF
from tests.baselines.small_fields import (
    BOX,
    EIGHT,
    OF_THE_CALL,
    PARTS,
    SMALL,
    every_depth,
    every_method,
    field_of,
    render,
    roughened,
    some_rays,
)


@every_method
@every_depth
def test_networks_are_as_deep_as_asked(method: str, depth: int) -> None:
    assert len(field_of(method, replace(SMALL, depth=depth)).density_net) == depth


def test_methods_share_nearly_all_first_weights_with_nerf() -> None:
    """Pairing holds shared ones to be equal; here it is that there are some to share."""
    reference = dict(field_of("nerf", EIGHT).named_parameters())
    for method in PARTS:
        weights = field_of(method, EIGHT).named_parameters()
        shared = [name for name, weight in weights if name in reference and weight.shape == reference[name].shape]
        assert len(shared) >= len(reference) - 3, method


def test_initial_weights_are_glorot_uniform_with_zero_biases() -> None:
    for name, weight in field_of("nerf", replace(SMALL, width=128)).named_parameters():
        if weight.ndim == 1:
            assert (weight == 0).all(), name
        else:
            bound = (6.0 / (weight.shape[0] + weight.shape[1])) ** 0.5
            assert weight.abs().max() <= bound, name
            if weight.numel() > 1000:
                assert float(weight.detach().std()) == pytest.approx(bound / 3**0.5, rel=0.1), name


def test_beta_gets_no_gradient_where_nothing_is_above_the_threshold() -> None:
    field = field_of("qnerf")
    with torch.no_grad():
        field.density_head.bias.fill_(-20.0)
    render(field, QNERF, some_rays()).colour.sum().backward()
    assert field.amplifier.beta.grad == 0.0  # type: ignore[attr-defined]


@torch.no_grad()
def chunk_difference(field: NetworkField, method: str, chunk: int = 4) -> float:
    some, parts = some_rays(100), PARTS[method]
    pieces = [render(field, parts, some.part(i, i + chunk)).colour for i in range(0, 100, chunk)]
    return float((torch.cat(pieces) - render(field, parts, some).colour).abs().max())


@pytest.mark.parametrize("method", OF_THE_CALL)
def test_chunks_do_matter_with_a_mean_of_the_call_once_alpha_has_moved(method: str) -> None:
    """A documented property of the paper's operators: their mean is that of the call, and it shows."""
    assert chunk_difference(roughened(field_of(method), alpha=1.0), method) > 1e-4


@pytest.mark.parametrize("method", [name for name in OF_THE_CALL if name != "qnerf_listing4"])
def test_chunks_do_not_matter_at_the_initial_alpha(method: str) -> None:
    """Eq. 4 is the identity there, up to rounding about a mean that differs."""
    assert chunk_difference(roughened(field_of(method)), method) <= 1e-4


@every_method
def test_listing_2_alone_says_that_density_is_bounded(method: str) -> None:
    limit = PARTS[method].density_unit(BOX) if "listing2" in PARTS[method].amplifier else math.inf
    assert field_of(method).density_limit == limit
