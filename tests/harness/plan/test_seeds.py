"""A generator for each purpose."""

import torch

from harness.plan.seeds import generator_for


def numbers(*purpose: int | str) -> list[float]:
    return torch.rand(4, generator=generator_for(*purpose)).tolist()


def test_a_purpose_has_its_numbers_in_every_order_and_leaves_the_global_generator_alone() -> None:
    first, before = numbers(0, 5, "batch"), torch.get_rng_state()
    numbers(0, 6, "batch")
    assert torch.equal(torch.get_rng_state(), before)
    torch.manual_seed(1)
    assert numbers(0, 5, "batch") == first


def test_different_purposes_have_different_numbers() -> None:
    purposes = [(0, 1, "batch"), (0, 1, "jitter"), (1, 0, "batch"), (0, 11, "batch"), (0, 1, "grid"), (0, "batch")]
    purposes += [(1, 23), (12, 3)]
    assert len({tuple(numbers(*purpose)) for purpose in purposes}) == len(purposes)


def test_a_purpose_has_the_same_seed_in_every_process_and_version() -> None:
    assert generator_for(3, 14, "batch").initial_seed() == 2002049673550745313


def test_seeds_of_neighbouring_purposes_are_unrelated() -> None:
    draws = torch.stack([torch.rand(50, generator=generator_for(0, step, "jitter")) for step in range(60)])
    correlation = torch.corrcoef(draws) - torch.eye(60)
    assert float(correlation.abs().max()) < 0.7
    assert abs(float(draws.mean()) - 0.5) < 0.02
