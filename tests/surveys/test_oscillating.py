"""Bends of oscillators, by which the bound of a query knows what lies within its steps."""

import numpy as np
import pytest
from test_query import made

from sphpod.numerics import propagator
from sphpod.surveys import oscillating

STEP, STEPS = 2e-3, 2000


@pytest.mark.parametrize("decay", [0.0, 0.3, 4.0, 40.0])
def test_no_oscillator_bends_more_than_is_said(decay) -> None:
    """From those that swing to those that creep; what swings comes near at some time."""
    _, survey = made({"damping": "100*decay"})
    query, _ = survey.model({"stiffness": 0.1, "contrast": 0.3, "decay": decay / 100})
    blocks, count = query.own.blocks, len(query.own.blocks)
    pairs = len(query.own_start) - count
    state = np.zeros((len(query.own_start), STEPS + 1))
    state[:, 0] = query.own_start
    still = np.zeros((1, count, 2))
    propagator.prepare(blocks, query.own.singles, still, STEP, STEPS + 1).run(state)
    frequency = blocks[:pairs, 0, 1, None]
    bend = frequency * (decay * state[:pairs] - frequency * state[count:])
    fading, lasting = oscillating.most_bends(query).T[:, :, None]
    most = lasting + fading * np.exp(-decay / 2 * STEP * np.arange(STEPS + 1))
    largest = np.abs(bend).max()
    assert np.all(np.abs(bend) <= most * (1 + 1e-9) + 1e-12 * largest)
    assert np.any(lasting > 0) == (decay >= 4)
    if decay < 4:
        assert np.all((np.abs(bend) > 0.9 * most).any(axis=1))
