"""Modes that all queries of a survey share: of what runs they are, and how many."""

import numpy as np
import pytest
from scenes import VARIED, scene

from sphpod.full import lifted
from sphpod.surveys.modes import shared_modes

PUSH = {"time": "1e-3*cos(20*t)", "profile": "1 + x"}


def trained(**changes):
    cases = [scene(youngs_modulus=c, **changes) for c in (0.08, 0.15)]
    solved = [(case, lifted.solve(case, "exact")) for case in cases]
    return solved, shared_modes(solved)


SCATTERED = {"positions": {"jitter": 0.2, "seed": 3}}
JUMP = {"initial_density": "where(x < L/2, 1, 2)"}
RESTING = {
    "initial_density": "1 + 0.5*sin(2*pi*x/L)",
    "initial_velocity": "1e-3*sin(2*pi*x/L) - 2.5e-4",
}


@pytest.mark.parametrize(
    "changes",
    [
        VARIED,
        SCATTERED,
        JUMP | {"particle_count": 20},
        JUMP | {"particle_count": 21},
        RESTING | {"particle_count": 20},
        RESTING | {"particle_count": 21},
        SCATTERED | JUMP | {"particle_count": 20},
        SCATTERED | JUMP | {"particle_count": 21},
    ],
)
def test_all_modes_hold_all_strains_and_what_moves_with_them(changes) -> None:
    changes = {key: value for key, value in changes.items() if key != "youngs_modulus"}
    solved, shared = trained(**changes)
    case, modes = solved[0][0], shared["velocity_modes"]
    np.testing.assert_allclose((modes * case.volumes) @ modes.T, np.eye(len(modes)), atol=1e-12)
    strains = case.derivative(modes)
    for _, fields in solved:
        for name, held, most in (("strain", strains, 1e-5), ("velocity", modes, 1e-4)):
            field = fields[name].T
            left = field - held.T @ np.linalg.lstsq(held.T, field)[0]
            assert np.linalg.norm(left) <= most * np.linalg.norm(field)


def test_the_constant_velocity_is_a_mode_where_momentum_changes() -> None:
    for changes, rigid in (
        ({}, 0),
        ({"force": PUSH}, 1),
        ({"force": PUSH, "positions": {"jitter": 0.2}}, 0),
    ):
        _, shared = trained(**changes)
        first = shared["velocity_modes"][0]
        assert int(shared["translation"]) == rigid
        assert (np.ptp(first) < 1e-12) == bool(changes)


def test_strains_of_one_displacement_are_one_mode() -> None:
    case = scene()
    wave = case.derivative(np.sin(2 * np.pi * case.positions))
    strain = np.stack([wave, wave + 0.1])
    shared = shared_modes([(case, {"velocity": 0 * strain, "strain": strain})])
    assert len(shared["velocity_modes"]) == 1
