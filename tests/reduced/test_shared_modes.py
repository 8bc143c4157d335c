"""Modes of velocity and stress that scenes of different parameters share."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import lifted
from sphpod.reduced import lifted_rom, shared_modes
from sphpod.reduced.error_bound import error_bounds


def solved(model):
    """Scaled fields of a model that is exact in time, one behind the other, and its bounds."""
    run = model.prepare("lifted_exact").run()
    velocity, strain = run.coordinates()
    fields = np.concatenate([velocity @ model.velocity_modes, strain @ model.strain_modes], axis=1)
    return fields, error_bounds(run)[0]


def full(case):
    """The same of the lifted full model."""
    fields = lifted.solve(case, "exact")
    mass, stiffness = lifted.energy_weights(case)
    return np.concatenate([mass * fields["velocity"], stiffness * fields["strain"]], axis=1)


def material(stiffness, contrast, decay, **changes):
    modulus = f"{stiffness}*(1 + {contrast}*sin(2*pi*x/L))"
    return scene(youngs_modulus=modulus, damping=decay, particle_count=24, **changes)


def close(one, other, tolerance):
    assert np.abs(one - other).max() <= tolerance * np.abs(other).max()


@pytest.mark.parametrize("changes", [{}, VARIED], ids=["uniform", "varied"])
def test_modes_of_all_particles_give_the_full_model_for_other_parameters(changes) -> None:
    case = scene(particle_count=20, **changes)
    shared = {"velocity_modes": np.eye(20), "stress_modes": np.eye(20), "translation": np.array(0)}
    close(solved(shared_modes.model(case, shared))[0], full(case), 1e-9)


def test_the_model_of_a_scenes_own_modes_is_its_lifted_model() -> None:
    case = scene(**VARIED)
    fields = lifted.solve(case, "exact")
    modes = lifted_rom.decompose(
        case,
        {
            "velocity_snapshots": fields["velocity"][::10],
            "strain_snapshots": fields["strain"][::10],
        },
    )
    own = lifted_rom.build(case, modes, 6)
    mass, stiffness = lifted.energy_weights(case)
    shared = {
        "velocity_modes": modes["scaled_velocity_modes"] / mass,
        "stress_modes": case.modulus() * modes["scaled_strain_modes"] / stiffness,
        "translation": modes["translation"],
    }
    close(solved(shared_modes.model(case, shared, 6))[0], solved(own)[0], 1e-9)


@pytest.fixture(scope="module")
def trained():
    cases = [
        material(stiffness, contrast, decay, duration=2, error_interval=0.02)
        for stiffness in (0.06, 0.2)
        for contrast, decay in ((0.1, 0.0), (0.5, 1.0))
    ]
    return shared_modes.train((case, lifted.solve(case, "exact")) for case in cases)


@settings(max_examples=40, deadline=None)
@given(
    stiffness=st.floats(0.05, 0.25),
    contrast=st.floats(0, 0.6),
    decay=st.floats(0, 2),
    count=st.integers(1, 12),
)
def test_a_bound_holds_and_energy_does_not_grow_for_any_parameters(
    trained, stiffness, contrast, decay, count
) -> None:
    case = material(stiffness, contrast, decay, duration=2, error_interval=0.02)
    reduced, bound = solved(shared_modes.model(case, trained, count))
    reference = full(case)
    size = np.linalg.norm(reference, axis=1).max()
    assert np.all(np.linalg.norm(reduced - reference, axis=1) <= bound + 1e-11 * size)
    energy = np.linalg.norm(reduced, axis=1) ** 2
    assert np.all(np.diff(energy) <= 1e-12 * energy.max())


def test_errors_fall_with_the_number_of_shared_modes(trained) -> None:
    case = material(0.11, 0.3, 0.4, duration=2, error_interval=0.02)
    reference = full(case)
    errors = [
        np.linalg.norm(solved(shared_modes.model(case, trained, k))[0] - reference, axis=1).max()
        for k in (2, 4, 8, 12)
    ]
    assert all(later < earlier for earlier, later in itertools.pairwise(errors))
    assert errors[-1] < 1e-2 * np.linalg.norm(reference, axis=1).max()


def test_momentum_is_that_of_the_full_model_for_any_parameters() -> None:
    """The constant velocity is a mode wherever a scene's momentum changes."""
    push = {"time": "1e-3*cos(20*t)", "profile": "1 + x"}
    train = [scene(youngs_modulus=c, force=push) for c in (0.08, 0.15)]
    shared = shared_modes.train((case, lifted.solve(case, "exact")) for case in train)
    assert int(shared["translation"]) == 1
    case = scene(youngs_modulus=0.11, force=push, initial_density="1 + 0.2*cos(2*pi*x/L)")
    mass, _ = lifted.energy_weights(case)
    momenta = [
        fields[:, :40] @ mass
        for fields in (solved(shared_modes.model(case, shared, 5))[0], full(case))
    ]
    close(momenta[0], momenta[1], 1e-10)


def test_modes_of_other_particles_and_dependent_ones_are_refused(trained) -> None:
    with pytest.raises(ValueError, match="particle_count = 40: the shared modes are of 24"):
        shared_modes.model(scene(), trained)
    twice = {**trained, "velocity_modes": np.repeat(trained["velocity_modes"][:1], 2, axis=0)}
    with pytest.raises(ValueError, match="linearly dependent"):
        shared_modes.model(material(0.1, 0, 0), twice)
    other = scene(particle_count=30)
    with pytest.raises(ValueError, match="positions"):
        shared_modes.train((case, lifted.solve(case, "exact")) for case in (scene(), other))
