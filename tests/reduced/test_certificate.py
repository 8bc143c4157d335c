"""Errors of lifted reduced models beside their bounds, and mode counts chosen by tolerance."""

import numpy as np
import pytest
from scenes import VARIED, scene

from sphpod.full import lifted
from sphpod.numerics.error import relative_error
from sphpod.reduced import certificate, error_bound, lifted_rom
from sphpod.scene.breakdown import Breakdown

ROUNDING = 1e-11
"""Of the initial norm: what rounding errors of both models may add to the error."""

SETTINGS = {
    "plain": {},
    "damped": {"damping": 3},
    "forced": {"force": "1e-3*cos(9*t)"},
    "damped and forced": {"damping": 3, "force": VARIED["force"]},
    "varied": VARIED,
}
each = pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
SOLVED: dict[str, dict] = {}
TENS = "1e-3*sum(cos(l**2)*sin(2*pi*l*x/L + l) for l in range(1, 9))"


def exact(case):
    """The lifted full model, solved once for each scene."""
    if repr(case) not in SOLVED:
        SOLVED[repr(case)] = lifted.solve(case, "exact")
    return SOLVED[repr(case)]


def decomposed(case, rows=slice(0, 50, 5)):
    """Modes of snapshots of the lifted full model."""
    taken = {f"{field}_snapshots": exact(case)[field][rows] for field in ("velocity", "strain")}
    return lifted_rom.decompose(case, taken)


def with_density(case, solution):
    return solution | {"density": lifted.density(case, solution["strain"])}


def size(case):
    """Norm of the initial energy."""
    return float(np.linalg.norm(lifted.energy_weights(case)[0] * case.velocity0()))


def true_errors(run):
    """Energy norm of the error against the lifted full model, at each time."""
    model = run.reduced
    squares = 0.0
    for field, weights, modes, coordinates in zip(
        ("velocity", "strain"),
        lifted.energy_weights(model.scene),
        (model.velocity_modes, model.strain_modes),
        run.coordinates(),
        strict=True,
    ):
        error = weights * exact(model.scene)[field] - coordinates @ modes
        squares = squares + np.sum(error**2, axis=1)
    return np.sqrt(squares)


@each
def test_certified_errors_are_those_of_reconstructed_fields(changes):
    case, count = scene(**changes), 4
    full, modes = exact(case), decomposed(case)
    reference = with_density(case, lifted.solve(case, "leapfrog"))
    arrays = certificate.certify(case, [count], modes, full, reference)
    run = lifted_rom.build(case, modes, count).prepare("lifted_exact").solve()
    found = with_density(case, run.fields())

    def energies(fields):
        return [
            np.sum((weights * fields[field]) ** 2, axis=1)
            for field, weights in zip(
                ("velocity", "strain"), lifted.energy_weights(case), strict=True
            )
        ]

    total = energies(full)
    wrong = energies({field: found[field] - full[field] for field in ("velocity", "strain")})
    largest = np.sqrt(sum(total).max())
    bound, plain = error_bound.error_bounds(run)
    expected = {
        "velocity_error_reference": relative_error(found["velocity"], reference["velocity"]),
        "density_error_reference": relative_error(found["density"], reference["density"]),
        "velocity_error_lifted": np.sqrt(wrong[0].sum() / total[0].sum()),
        "strain_error_lifted": np.sqrt(wrong[1].sum() / total[1].sum()),
        "energy_error_lifted": np.sqrt(sum(wrong).max()) / largest,
        "energy_error_bound": bound.max() / largest,
        "residual_bound": plain.max() / largest,
    }
    for name, value in expected.items():
        assert arrays[name] == pytest.approx([value], rel=1e-9), name
    np.testing.assert_allclose(arrays["error_bound"], bound, rtol=1e-12)
    np.testing.assert_array_equal(arrays["t"], case.error_times)
    slack = (bound - true_errors(run)).min() / largest
    assert arrays["bound_slack"] == pytest.approx([slack], rel=1e-6, abs=1e-13)


@pytest.mark.slow
@each
def test_a_sweep_certifies_as_single_models_do(changes):
    case = scene(**changes, initial_velocity=TENS)
    full, modes = exact(case), decomposed(case)
    solutions = full, with_density(case, full)
    counts = [1, 2, 5, 100]
    sweep = certificate.certify(case, counts, modes, *solutions)
    for n, count in enumerate(counts):
        single = certificate.certify(case, [count], modes, *solutions)
        for name, values in sweep.items():
            np.testing.assert_allclose(values[n : n + 1], single[name], rtol=1e-9, atol=1e-13)
        assert single["error_bound"].shape == single["t"].shape
    assert set(single) - set(sweep) == {
        "t", "scaled_velocity_coordinates", "scaled_strain_coordinates", "error_bound",
        "reduced_operator", "reduced_force", "velocity_output", "strain_output",
    }  # fmt: skip
    assert np.all(sweep["energy_error_bound"] >= sweep["energy_error_lifted"] - ROUNDING)
    assert np.all(sweep["residual_bound"] >= sweep["energy_error_bound"])
    assert np.all(sweep["bound_slack"] >= -ROUNDING)
    # All modes at once are the best model.
    assert sweep["difference_from_best"][-1] == 0
    assert np.all(sweep["difference_from_best"][:-1] > 0)


def strained(amplitude):
    """Two waves that strain so much that a model with only one of them breaks down."""
    wave = f"{amplitude}*(sin(2*pi*x/L) + 0.6*sin(6*pi*x/L))"
    return scene("crash", initial_velocity=wave)


def test_breakdown_is_infinite_in_a_sweep_and_raised_of_one():
    case, modes = strained(0.25), decomposed(strained(0.01))
    solutions = exact(case), with_density(case, exact(case))
    sweep = certificate.certify(case, [1, 2], modes, *solutions)
    assert sweep["breakdown_time"][0] == pytest.approx(0.41)
    assert np.isnan(sweep["breakdown_time"][1])
    assert np.isnan(sweep["bound_slack"][0])
    for name in set(sweep) - {"mode_count", "modes_resolved", "breakdown_time", "bound_slack"}:
        assert np.isinf(sweep[name][0]), name
        assert np.isfinite(sweep[name][1]), name
    with pytest.raises(Breakdown, match="scene crash: the lifted model with 1 modes"):
        certificate.certify(case, [1], modes, *solutions)
    # A model that breaks down is not chosen, however large the tolerance; the best one must hold.
    assert certificate.choose(case, 0.99, modes)["mode_count"] == 2
    with pytest.raises(Breakdown, match="scene crash: the lifted model with 2 modes"):
        certificate.choose(strained(0.3), 0.99, modes)


@pytest.mark.slow
@each
def test_the_smallest_model_within_the_tolerance_is_chosen(changes):
    case = scene(**changes)
    full, modes = exact(case), decomposed(case)
    solutions = full, with_density(case, full)
    best, norm = len(modes["scaled_velocity_modes"]), certificate.Best.of(case, modes).norm
    sweep = certificate.certify(case, range(1, best + 1), modes, *solutions)
    for tolerance in (0.5, 1e-1, 1e-2, 1e-4, 1e-8, 1e-14):
        chosen = certificate.choose(case, tolerance, modes)
        count = int(chosen["mode_count"][0])
        assert chosen["best_mode_count"] == best
        assert sweep["difference_from_best"][count - 1] <= tolerance
        assert np.all(sweep["difference_from_best"][: count - 1] > tolerance)
        single = certificate.certify(case, [count], modes, *solutions)
        for name in set(chosen) & set(single) - {"energy_error_bound", "residual_bound"}:
            np.testing.assert_array_equal(chosen[name], single[name])
        # Relative to the best model, as nothing is known of the full one.
        ratio = single["error_bound"].max() / single["energy_error_bound"][0] / norm
        for name in ("energy_error_bound", "residual_bound"):
            np.testing.assert_allclose(chosen[name], single[name] * ratio, rtol=1e-9)
        assert chosen["certified"] == (chosen["energy_error_bound"][0] <= tolerance)
        # What is certified is so.
        error = single["energy_error_lifted"][0] * ratio
        assert not chosen["certified"] or error <= tolerance + ROUNDING


def test_models_are_certified_and_not():
    """Three waves are three modes; of eight waves a short time shows too little."""
    chosen = certificate.choose(scene(), 1e-2, decomposed(scene()))
    assert chosen["certified"]
    many = scene(initial_velocity=TENS)
    chosen = certificate.choose(many, 1e-2, decomposed(many, slice(0, 20, 5)))
    assert not chosen["certified"]


@pytest.mark.parametrize(
    ("certified", "bound", "sentence"),
    [
        (1, 4.56e-3, "certified: the bound 4.6e-03 is within 0.01"),
        (0, 0.123, "not certified: the bound 1.2e-01 is not within 0.01"),
        # Of a best model in which nothing moves.
        (0, np.nan, "not certified: nothing moves in it that the bound could be relative to"),
    ],
)
def test_the_verdict_is_said_in_words(certified, bound, sentence):
    chosen = {
        "tolerance": np.array(1e-2),
        "mode_count": np.array([7]),
        "difference_from_best": np.array([2.34e-3]),
        "energy_error_bound": np.array([bound]),
        "certified": np.array(certified),
    }
    words = certificate.verdict(chosen)
    assert words == f"7 modes are within 2.3e-03 of the best model; {sentence}"
