"""Finite-difference references."""

import numpy as np
import pytest
from scenes import VARIED, scene

from sphpod.numerics.error import FIELDS, relative_error
from sphpod.reference import exact, reference
from sphpod.scene.breakdown import Breakdown


def errors(solve, field, counts, **changes):
    found = []
    for count in counts:
        case = scene(particle_count=count, time_step=0.04 / count, error_interval=0.02, **changes)
        found.append(relative_error(solve(case)[field], exact.solve(case)[field]))
    return np.array(found)


@pytest.mark.parametrize("changes", [{}, {"damping": 3, "force": "1e-3*cos(9*t)"}])
def test_orders(changes):
    """Velocity is second order in both; density only where it is brought back to the particles.

    The density of the paper's reference lives a quarter of a particle spacing beside where it is
    compared, which leaves it first order.
    """
    counts = (16, 32, 64)
    for solve, field, order in (
        (reference.solve_paper, "velocity", 2),
        (reference.solve_paper, "density", 1),
        (reference.solve_centred, "velocity", 2),
        (reference.solve_centred, "density", 2),
    ):
        found = errors(solve, field, counts, **changes)
        np.testing.assert_allclose(np.log2(found[:-1] / found[1:]), order, atol=0.15)


LAYER = "where(abs(x/L - 0.4217) < 0.2, 1, {})"
KINK = "1e-3*x*(L - x)"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "order"),
    [
        ({}, 2),
        ({"damping": 3, "force": "1e-3*cos(9*t)"}, 2),
        ({"initial_velocity": "1e-3*exp(-200*(x/L - 1/2)**2)"}, 2),
        ({"initial_velocity": KINK}, 1),
        ({"initial_velocity": "1e-3*where(x < 0.37*L, 1, 0)"}, 1 / 3),
        ({"initial_velocity": "1e-3*x/L"}, 1 / 3),
        ({"youngs_modulus": "where(0 < x/L <= 1/2, 0.1, 0.2)"}, 1),
        ({"youngs_modulus": "0.1*" + LAYER.format(2)}, 1),
        ({"initial_density": LAYER.format(4)}, 5 / 3),
        ({"youngs_modulus": "0.1*" + LAYER.format(2), "initial_velocity": KINK}, 1),
        ({"youngs_modulus": "0.1*" + LAYER.format(2), "positions": {"jitter": 0.3, "seed": 1}}, 1),
        ({"damping": 3, "force": {"time": "1e-2*cos(9*t)", "profile": "where(x < 0.35, 1, 0)"}}, 1),
    ],
    ids=[
        "waves", "damped-forced", "gaussian", "kink", "jump", "jump-at-the-seam", "moduli",
        "moduli-off-the-grid", "densities-off-the-grid", "moduli-kink", "jittered-moduli",
        "jumping-force",
    ],
)  # fmt: skip
def test_the_estimate_is_one_to_three_times_the_error(changes, order):
    """With the orders that second-order differences have: 2, 1 at kinks and 1/3 at jumps of v."""
    wave = {"initial_velocity": "1e-3*sin(2*pi*x/L)"}
    for count in (50, 77, 200, 800):
        case = scene(
            particle_count=count, time_step=0.02 / (count // 5), error_interval=0.02,
            **(wave | changes),
        )  # fmt: skip
        result, truth = reference.solve_centred(case), exact.solve(case)
        assert result["asymptotic"] == 1
        for field in FIELDS:
            ratio = result[f"{field}_error_estimate"] / relative_error(result[field], truth[field])
            assert 1 <= ratio <= 3, (count, field)
            assert abs(result[f"{field}_observed_order"] - order) < 0.65


@pytest.mark.parametrize(
    ("velocity", "count"),
    [("sin(20*pi*x/L)", 50), ("sin(2*pi*x/L) + 0.5*cos(8*pi*x/L) + 0.2*sin(26*pi*x/L)", 77)],
    ids=["a short wave", "a short wave among long ones"],
)
def test_waves_that_run_out_of_phase_on_coarser_grids_leave_no_estimate(velocity, count):
    """In all, the differences fall as those of a jump do; in the last of the time they grow."""
    case = scene(
        particle_count=count, duration=10, error_interval=0.02, time_step=0.02 / (count // 5),
        initial_velocity=f"1e-3*({velocity})",
    )  # fmt: skip
    result = reference.solve_centred(case)
    assert result["asymptotic"] == 0
    assert 0.2 < result["velocity_observed_order"] < 0.4


def test_the_estimate_is_right_where_damping_jumps():
    """No exact solution is known; one of sixteen nodes a particle has a fourth of the error."""
    case = scene(particle_count=50, time_step=2e-3, damping="where(x/L < 0.35, 3, 0)")
    result = reference.solve_centred(case)
    many = scene(particle_count=200, time_step=5e-4, damping="where(x/L < 0.35, 3, 0)")
    truth = reference.solve_centred(many, estimate_error=False)
    for field in FIELDS:
        ratio = result[f"{field}_error_estimate"] / relative_error(
            result[field], truth[field][:, ::4]
        )
        assert 1 <= ratio <= 3


@pytest.mark.parametrize(
    "time",
    ["where(0.5101 < t < 0.5102, 10, 0)", "where(t < 0.3, 1e-2, 0)", "abs(sin(9*t))*1e-2"],
    ids=["pulse within a step", "jump", "kinks"],
)
def test_an_uneven_force_that_breaks_between_steps_is_estimated(time):
    case = scene(
        duration=2, particle_count=60, force={"time": time, "profile": "sin(2*pi*x/L)"},
        error_interval=0.1, youngs_modulus=0.4, time_step=5e-3, initial_velocity=0,
    )  # fmt: skip
    found, truth = reference.solve_centred(case), exact.solve(case)
    for field in FIELDS:
        error = relative_error(found[field], truth[field])
        assert 1 <= found[f"{field}_error_estimate"] / error <= 3


def test_particles_too_few_for_an_estimate_are_reported_of(caplog):
    case = scene("coarse", particle_count=16, initial_velocity="1e-3*sin(16*pi*x/L)")
    result = reference.solve_centred(case)
    (record,) = caplog.records
    assert record.getMessage().startswith("scene coarse: reference centred: its error is not est")
    assert result["asymptotic"] == 0
    assert all(np.isnan(result[f"{field}_error_estimate"]) for field in FIELDS)


def test_a_coarser_grid_that_breaks_down_leaves_no_estimate(caplog):
    """The midpoint rule is stable for steps below 2/d, which those of the coarsest grid are not."""
    result = reference.solve_centred(scene(time_step=5e-3, damping=500))
    assert (result["density"] > 0).all()
    assert result["asymptotic"] == 0
    assert all(np.isnan(result[f"{field}_observed_order"]) for field in FIELDS)
    assert len(caplog.records) == 1


@pytest.mark.parametrize("velocity", [0, 0.3])
def test_what_does_not_move_has_no_error(velocity):
    result = reference.solve_centred(scene(initial_velocity=velocity))
    assert result["asymptotic"] == 1
    for field in FIELDS:
        assert result[f"{field}_error_estimate"] == 0
        assert np.isnan(result[f"{field}_observed_order"])


@pytest.mark.parametrize(
    ("differences", "asymptotic"),
    [((1, 4), True), ((1, 1), False), ((1, -4), False), ((2, 1), False), ((1, 8), False)],
    ids=["second order", "none", "from side to side", "growing", "third order"],
)
def test_orders_that_no_estimate_rests_on(differences, asymptotic):
    """Solutions of one value: the middle and the coarse one differ from the last by so much."""
    middle = 1 + 1e-3 * differences[0]
    grids = (np.full((3, 4), value) for value in (1.0, middle, middle + 1e-3 * differences[1]))
    estimate, order = reference.richardson(*grids)
    assert np.isnan(estimate) != asymptotic
    assert order == pytest.approx(np.log2(abs(differences[1] / differences[0])))


def test_parallel_errors_are_those_of_richardson():
    """u + a h^p of three grids: its error is a h^p, whatever the order."""
    shape = np.sin(np.arange(20.0)).reshape(4, 5)
    truth = 1 + np.cos(np.arange(20.0)).reshape(4, 5)
    fine, middle, coarse = (truth + 1e-4 * h**1.9 * shape for h in (1, 2, 4))
    estimate, order = reference.richardson(fine, middle, coarse)
    assert order == pytest.approx(1.9)
    assert estimate == pytest.approx(reference.SAFETY * relative_error(fine, truth), rel=1e-3)


def test_an_error_that_nobody_asks_for_is_not_estimated():
    result = reference.solve_centred(scene(), estimate_error=False)
    assert set(result) == {"t", "x", "velocity", "density"}


def test_centred_reference_of_varied_material_converges():
    coarse, middle, fine = (
        reference.solve_centred(
            scene(particle_count=n, time_step=0.02 / n, error_interval=0.02, **VARIED)
        )
        for n in (16, 32, 64)
    )
    for field in ("velocity", "density"):
        first = relative_error(coarse[field], middle[field][:, ::2])
        second = relative_error(middle[field], fine[field][:, ::2])
        assert np.log2(first / second) == pytest.approx(2, abs=0.15)


def test_breakdown_names_scene_time_and_particle():
    case = scene("crash", initial_velocity="5*sin(2*pi*x/L)")
    with pytest.raises(Breakdown, match=r"scene crash: the finite-difference reference broke down"):
        reference.solve_paper(case)


@pytest.mark.parametrize("solve", [reference.solve_paper, reference.solve_centred])
def test_breakdown_between_outputs_does_not_pass(solve):
    """Waves that are back where they began at the end, and fold the line on the way."""
    changes = {"duration": 3.2, "time_step": 2e-3, "youngs_modulus": 0.09765625}
    for interval in (3.2, 0.02):
        case = scene(**changes, error_interval=interval, initial_velocity="0.45*sin(2*pi*x/L)")
        with pytest.raises(Breakdown) as caught:
            solve(case)
        assert caught.value.time == pytest.approx(3.2 if interval == 3.2 else 0.42, abs=0.05)
    solve(scene(**changes, error_interval=3.2, initial_velocity="0.25*sin(2*pi*x/L)"))


@pytest.mark.parametrize("changes", [{}, {"force": "1e-3*cos(9*t)"}], ids=["waves", "forced"])
def test_jittered_particles_are_reached_by_cubics(changes):
    """With an error of fourth order, that of the differences themselves is of second."""
    jitter = {"positions": {"jitter": 0.4, "seed": 2}}
    even = errors(reference.solve_centred, "velocity", (20, 40), **changes)
    found = errors(reference.solve_centred, "velocity", (20, 40), **changes, **jitter)
    assert found[0] < 3 * even[0]
    assert found[1] < 1.1 * even[1]
