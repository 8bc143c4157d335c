"""Queries: certified, stable for any parameters, and the full model where the modes are all."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from examples import examples
from hypothesis import given
from hypothesis import strategies as st
from survey_cases import SCENE

from sphpod.config.config import load
from sphpod.full import lifted
from sphpod.reduced.error_bound import error_bounds
from sphpod.reduced.lifted_rom import LiftedModel, build, decompose
from sphpod.scene.scene import parameter_values
from sphpod.surveys import samples
from sphpod.surveys.corrections import correction_modes
from sphpod.surveys.modes import shared_modes
from sphpod.surveys.parts import Operators
from sphpod.surveys.query import Survey

FORCE = {"time": "1e-3*cos(20*t)", "profile": "1 + x"}
CASES: dict[str, dict[str, Any]] = {
    "uniform_damping": {},
    "all_affine": {"youngs_modulus": "stiffness*(1 + 0.3*sin(2*pi*x/L))", "initial_velocity": (
        "1e-3*(sin(2*pi*x/L) + contrast*cos(4*pi*x/L))"
    )},
    "uneven_damping": {"damping": "decay*(1 + 0.5*sin(2*pi*x/L))"},
    "forced": {"force": FORCE},
    "density": {"initial_density": "1 + contrast*x*(L - x)", "youngs_modulus": "stiffness"},
    "layers": {"youngs_modulus": "where(x < L/2, stiffness, stiffness*(1 + contrast))"},
    "scaled": {
        "initial_density": "(1 + contrast)*(1 + 0.2*cos(2*pi*x/L))", "youngs_modulus": "stiffness",
    },
    "scattered": {
        "positions": {"jitter": 0.2, "seed": 1}, "initial_velocity": "1e-3*(1 + sin(2*pi*x/L))",
    },
    "inclusion": {"youngs_modulus": "stiffness*(1 - 0.5*exp(-((x - L/2 - contrast/4)/0.1)**2))"},
}  # fmt: skip


def made(case, count=8, training=4, particles=24):
    """Settings of a scene, and its survey; a case by name, or its keys."""
    changes = CASES[case] if isinstance(case, str) else case
    scene = {**SCENE, "error_interval": 0.05, **changes, "particle_count": particles}
    resolved = load([], {"scenes": {"bar": scene}})["scenes"]["bar"]
    points = samples.points(resolved["parameters"], {"count": training})
    cases = [samples.scene_at("bar", resolved, point_of(resolved, one)) for one in points]
    shared = shared_modes((case, lifted.solve(case, "exact")) for case in cases)

    def surveyed(count, **corrections):
        return Survey(Operators("bar", resolved, shared | corrections), count)

    if not surveyed(count).operators.is_affine:
        return resolved, surveyed(count)
    modes = correction_modes(surveyed, count, [point_of(resolved, one) for one in points])
    return resolved, surveyed(count, correction_modes=modes)


def point_of(resolved, values):
    return dict(zip(resolved["parameters"], map(float, values), strict=True))


def scaled(survey, answer, scene):
    """Scaled fields of an answer and of the full model, one behind the other."""
    mass, stiffness = lifted.energy_weights(scene)
    velocity, strain = answer.fields(survey.operators)
    full = lifted.solve(scene, "exact")
    ours = np.concatenate([mass * velocity, stiffness * strain], axis=1)
    return ours, np.concatenate([mass * full["velocity"], stiffness * full["strain"]], axis=1)


@pytest.fixture(scope="module")
def surveys():
    return {case: made(case) for case in CASES}


@examples(500)
@given(
    case=st.sampled_from(sorted(CASES)),
    shares=st.tuples(*[st.floats(0, 1)] * 3),
    count=st.integers(1, 10),
)
def test_the_bound_holds_and_energy_does_not_grow(surveys, case, shares, count) -> None:
    resolved, survey = surveys[case]
    survey = Survey(survey.operators, max(count, 1 + survey.operators.rigid))
    point = point_of(resolved, samples.spread(resolved["parameters"], np.array([shares]))[0])
    answer = survey.answer(point)
    scene = samples.scene_at("bar", resolved, point)
    ours, full = scaled(survey, answer, scene)
    size = np.linalg.norm(full, axis=1).max()
    error = np.linalg.norm(ours - full, axis=1)
    assert np.all(error <= answer.bound + 1e-11 * size)
    assert error.max() <= answer.relative_bound * size * (1 + 1e-9) + 1e-11 * size
    if not scene.forces:
        energy = answer.norms**2
        assert np.all(np.diff(energy) <= 1e-12 * energy.max())
    np.testing.assert_allclose(answer.norms, np.linalg.norm(ours, axis=1), rtol=1e-9)


@pytest.mark.parametrize("case", sorted(CASES))
def test_modes_of_all_particles_give_the_full_model(surveys, case) -> None:
    resolved, survey = surveys[case]
    rigid = survey.operators.rigid
    rest = np.linalg.svd(np.ones((1, 24)))[2][1:]
    modes = np.concatenate([np.ones((1, 24)), rest]) if rigid else np.eye(24)
    shared = {"velocity_modes": modes, "translation": rigid}
    whole = Survey(Operators("bar", resolved, shared), 24)
    point = {"stiffness": 0.07, "contrast": 0.21, "decay": 0.9}
    ours, full = scaled(whole, whole.answer(point), samples.scene_at("bar", resolved, point))
    assert np.abs(ours - full).max() <= 1e-9 * np.abs(full).max()


@pytest.mark.parametrize("case", sorted(CASES))
def test_a_query_is_the_lifted_model_of_its_modes_and_their_strains(surveys, case) -> None:
    resolved, survey = surveys[case]
    nominal = parameter_values(resolved)
    scene, operators = samples.scene_at("bar", resolved, nominal), survey.operators
    answer = survey.answer(nominal)
    mass, stiffness = lifted.energy_weights(scene)
    own = LiftedModel(
        scene,
        np.linalg.qr((mass * operators.velocity_modes[: survey.count]).T)[0].T,
        np.linalg.qr((stiffness * operators.strain_modes[operators.rigid : survey.count]).T)[0].T,
        operators.rigid,
    )
    velocity, strain = own.prepare("lifted_exact").run().coordinates()
    ours, _ = scaled(survey, answer, scene)
    theirs = np.concatenate([velocity @ own.velocity_modes, strain @ own.strain_modes], axis=1)
    assert np.abs(ours - theirs).max() <= 1e-9 * np.abs(ours).max()


@pytest.mark.parametrize("case", sorted(CASES))
def test_models_of_other_modes_are_within_both_bounds(surveys, case) -> None:
    """Those of the nominal run alone, of velocity and of strain each by itself."""
    resolved, survey = surveys[case]
    nominal = parameter_values(resolved)
    scene = samples.scene_at("bar", resolved, nominal)
    answer = survey.answer(nominal)
    ours, full = scaled(survey, answer, scene)
    fields = lifted.solve(scene, "exact")
    names = "velocity", "strain"
    modes = decompose(scene, {f"{name}_snapshots": fields[name][1:4] for name in names})
    other = build(scene, modes).prepare("lifted_exact").run()
    bound, _ = error_bounds(other)
    velocity, strain = other.coordinates()
    theirs = np.concatenate(
        [velocity @ other.reduced.velocity_modes, strain @ other.reduced.strain_modes], axis=1
    )
    difference = np.linalg.norm(ours - theirs, axis=1)
    size = np.linalg.norm(full, axis=1).max()
    assert np.all(difference <= answer.bound + bound + 1e-11 * size)
    assert difference.max() > 1e-4 * size


def test_what_falls_apart_is_not_evaluated_at_the_particles(surveys, monkeypatch) -> None:
    point = {"stiffness": 0.07, "contrast": 0.21, "decay": 0.9}
    for case in ("uniform_damping", "all_affine", "forced", "scaled"):
        operators = surveys[case][1].operators
        rough = Survey(operators, 4, tolerance=np.inf)
        rough.answer(point)
        with monkeypatch.context() as patched:
            patched.setattr("sphpod.surveys.fields.ParametricField.at", None)
            rough.answer(point)
    assert not surveys["inclusion"][1].operators.is_affine


def test_momentum_is_exact_for_any_parameters(surveys) -> None:
    resolved, survey = surveys["forced"]
    point = {"stiffness": 0.19, "contrast": 0.6, "decay": 0.0}
    scene = samples.scene_at("bar", resolved, point)
    ours, full = scaled(
        Survey(survey.operators, 3), Survey(survey.operators, 3).answer(point), scene
    )
    mass, _ = lifted.energy_weights(scene)
    momenta = [fields[:, : mass.size] @ mass for fields in (ours, full)]
    np.testing.assert_allclose(momenta[0], momenta[1], atol=1e-10 * np.abs(momenta[1]).max())


def test_dependent_modes_are_refused(surveys) -> None:
    resolved, survey = surveys["uniform_damping"]
    operators = survey.operators
    shared = {
        "velocity_modes": np.repeat(operators.velocity_modes[:1], 2, axis=0),
        "translation": 0,
    }
    twice = Survey(Operators("bar", resolved, shared), 2)
    with pytest.raises(ValueError, match="linearly dependent"):
        twice.answer({"stiffness": 0.1, "contrast": 0.2, "decay": 0.3})


def test_a_modulus_that_is_not_positive_is_refused(surveys) -> None:
    _, survey = surveys["uniform_damping"]
    with pytest.raises(ValueError, match="must be positive everywhere"):
        survey.answer({"stiffness": 0.1, "contrast": 1.2, "decay": 0.3})
    _, survey = surveys["all_affine"]
    with pytest.raises(ValueError, match="must be positive everywhere"):
        survey.answer({"stiffness": -0.1, "contrast": 0.2, "decay": 0.3})


def test_a_model_of_all_modes_has_no_estimate() -> None:
    resolved, few = made("forced", count=4)
    nominal = parameter_values(resolved)
    assert few.answer(nominal).estimate > 0
    whole = Survey(few.operators, len(few.operators.velocity_modes))
    assert np.isnan(whole.answer(nominal).estimate)


def test_nothing_is_known_of_the_relative_error_where_all_may_be_at_rest() -> None:
    resolved, survey = made("forced")
    answer = survey.answer(parameter_values(resolved))
    unknown = replace(answer, start_norm=0.0, bound=2 * answer.norms.max() + 0 * answer.bound)
    assert unknown.relative_bound == np.inf
    assert replace(unknown, bound=0 * answer.bound).relative_bound == 0
