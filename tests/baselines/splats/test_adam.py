"""The compiled step of Adam against torch's, each Gaussian with steps of its own."""

import numpy as np
import pytest
import torch

from baselines.splats.adam import Moments, step

BETAS, EPSILON = np.array([0.8, 0.95], np.float32), np.float32(1e-15)


def moments(count: int, columns: int) -> Moments:
    return Moments(*(np.zeros((count, size), np.float32) for size in (columns, columns, 1)))


def test_steps_are_those_of_torch_and_a_gaussian_that_joins_later_begins_with_its_first() -> None:
    draw = np.random.default_rng(0)
    count, columns, late = 5, 14, 3
    rates = draw.uniform(0.001, 0.1, columns).astype(np.float32)
    values = draw.normal(size=(count, columns)).astype(np.float32)
    theirs = [torch.tensor(values[:, c], dtype=torch.float64, requires_grad=True) for c in range(columns)]
    groups = [{"params": [part], "lr": float(rate)} for part, rate in zip(theirs, rates, strict=True)]
    adam = torch.optim.Adam(groups, betas=(0.8, 0.95), eps=1e-15)
    state = moments(count, columns)
    for turn in range(6):
        gradient = draw.normal(size=(count, columns)).astype(np.float32)
        if turn == late:
            for part in (*state, values[None]):
                part[..., -1, :] = values[-1] if part.ndim == 3 else 0.0
        out = np.empty_like(values)
        assert step(values, gradient, state, rates, BETAS, EPSILON, out)
        values = out
        for c, part in enumerate(theirs):
            part.grad = torch.from_numpy(gradient[:, c]).double()
        adam.step()
    expected = torch.stack([part.detach() for part in theirs], dim=1).numpy()
    np.testing.assert_allclose(values[:-1], expected[:-1], rtol=1e-4, atol=1e-5)
    assert state.seen[:, 0].tolist() == [6, 6, 6, 6, 6 - late]
    assert np.abs(values[-1] - expected[-1]).max() > 1e-3


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_what_is_not_finite_is_said(wrong: float) -> None:
    gradient = np.zeros((3, 14), np.float32)
    gradient[1, 4] = wrong
    some = np.ones((3, 14), np.float32)
    assert not step(some, gradient, moments(3, 14), np.ones(14, np.float32), BETAS, EPSILON, np.empty_like(some))
