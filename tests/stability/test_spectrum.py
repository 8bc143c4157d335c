"""What the spectrum says of waves and time steps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import VARIED, scene

from sphpod.full import lifted
from sphpod.scene.kernel import stencil_weights
from sphpod.stability import spectrum
from sphpod.stability.spectrum import Block, FullSpectrum
from sphpod.studies.time_steps import march_full

UNFORCED = {name: text for name, text in VARIED.items() if name != "force"}
SETTINGS = {
    "plain": {},
    "damped": {"damping": 3},
    "stiffly damped": {"damping": 40},
    "uneven material": UNFORCED | {"damping": 2},
    "unevenly damped": UNFORCED,
    "jittered": {"damping": 1, "positions": {"jitter": 0.2, "seed": 3}},
}
each = pytest.mark.parametrize("changes", SETTINGS.values(), ids=SETTINGS)
each_integrator = pytest.mark.parametrize("integrator", lifted.INTEGRATORS)
frequency = st.floats(1e-2, 1e3)
damping = st.one_of(st.just(0.0), st.floats(1e-3, 1e3))


def wave(omega, d):
    return Block(np.array([[omega]]), np.array([d]), np.eye(1), np.eye(1))


def radius(block, integrator, time_step):
    return np.abs(np.linalg.eigvals(block.step(integrator, time_step))).max()


def test_frequencies_of_a_uniform_line_are_those_of_its_stencil():
    case = scene(smoothing_ratio=1.7)
    weights = stencil_weights(case.spacing, case.smoothing_ratio)
    angles = 2 * np.pi * np.arange(case.particle_count) / case.particle_count
    k = np.arange(1, weights.size + 1)
    symbol = np.abs(2 * np.sin(np.outer(angles, k)) @ weights) * np.sqrt(0.1)
    expected = np.sort(symbol)[::-1]
    np.testing.assert_allclose(spectrum.frequencies(case), expected, atol=1e-12 * expected[0])


@settings(deadline=None, max_examples=100)
@given(frequency, damping)
def test_rates_of_a_wave_are_the_roots_of_its_equation(omega, d):
    fast, slow = spectrum.wave_rates(np.array([omega]), d)[:, 0]
    # By their sum and their product, of which neither loses digits.
    assert fast + slow == pytest.approx(-d, rel=1e-14, abs=1e-14 * omega)
    assert fast * slow == pytest.approx(omega**2, rel=1e-13)
    assert max(fast.real, slow.real) <= 0
    assert d > 0 or fast.real == 0


@each
def test_rates_of_the_full_model_are_eigenvalues_of_its_operator(changes):
    case = scene(**changes)
    matrix = lifted.operator(case).toarray()
    rates = FullSpectrum(case).rates.ravel()
    assert rates.sum() == pytest.approx(np.trace(matrix), rel=1e-9, abs=1e-9)
    for rate in rates[:: len(rates) // 7]:
        smallest = np.linalg.svd(matrix - rate * np.eye(len(matrix)), compute_uv=False)[-1]
        assert smallest < 1e-10 * np.linalg.norm(matrix)


@settings(deadline=None, max_examples=100)
@given(frequency, st.floats(1e-3, 1e3))
def test_explicit_euler_neither_grows_nor_decays_at_its_limit(omega, d):
    """Where a rate is too slow to tell from zero beside the other, the other decides."""
    limit = spectrum.euler_limits(spectrum.wave_rates(np.array([omega]), d)).min()
    assert radius(wave(omega, d), "explicit_euler", limit) == pytest.approx(1, abs=1e-9)
    if d < 2 * omega:
        assert limit == pytest.approx(d / omega**2)
    assert radius(wave(omega, d), "explicit_euler", 1.01 * limit) > 1
    assert radius(wave(omega, d), "explicit_euler", 0.99 * limit) <= 1


def test_neutral_modes_set_no_limit_and_undamped_waves_allow_no_step():
    rates = np.array([0, 1e-12, 3j, -3j, -2, 1 + 1j])
    np.testing.assert_array_equal(spectrum.euler_limits(rates), [np.inf, np.inf, 0, 0, 1, 0])
    assert spectrum.euler_limits(np.array([1e-3, -1]), blur=1e-2).tolist() == [np.inf, 2]


@settings(deadline=None, max_examples=50)
@given(frequency, st.floats(1e-5, 1e-1))
def test_undamped_explicit_euler_grows_by_half_its_step_times_frequency_squared(omega, angle):
    dt = angle / omega
    (rate,) = spectrum.euler_growth_rates(np.array([1j * omega]), dt)
    assert rate * dt == pytest.approx(np.log(radius(wave(omega, 0), "explicit_euler", dt)), 1e-4)
    assert rate == pytest.approx(omega**2 * dt / 2, rel=angle**2)


@pytest.mark.parametrize("integrator", spectrum.SPLITTINGS)
@settings(deadline=None, max_examples=60)
@given(omega=frequency, d=damping)
def test_splittings_are_stable_up_to_their_limit_and_not_beyond(integrator, omega, d):
    d = min(d, 20 * omega)
    limit = spectrum.splitting_limit(omega, d)
    assert limit >= 2 / omega * (1 - 1e-12)
    for part in (0.1, 0.5, 0.9, 0.999):
        assert radius(wave(omega, d), integrator, part * limit) <= 1 + 1e-12
    for part in (1.001, 1.5, 4):
        assert radius(wave(omega, d), integrator, part * limit) > 1 + 1e-9


@each
@pytest.mark.parametrize("integrator", ["explicit_euler", *spectrum.SPLITTINGS, *lifted.ADAPTIVE])
def test_limits_of_waves_are_those_of_the_whole_model(changes, integrator):
    full = FullSpectrum(scene(**changes))
    limit = full.limit(integrator)
    if limit == 0:
        assert not full.damping.any()
        assert integrator == "explicit_euler"
        limit = 1e-6
    else:
        # At the limit itself undamped waves are at double roots.
        assert radius(full.whole, integrator, 0.999 * limit) < 1 + 1e-6
    assert radius(full.whole, integrator, 1.001 * limit) > 1 + 1e-12


@each
@each_integrator
def test_the_step_is_that_of_the_model(changes, integrator):
    case = scene(**changes)
    state = np.random.default_rng(0).standard_normal(2 * case.particle_count)
    dt = 0.02
    step = FullSpectrum(case).whole.step(integrator, dt)
    expected = step @ step @ state
    steps = 1 if integrator == "exact" else 2
    found = march_full(case, integrator)(state, 2 * dt / steps, steps, 1)[-1]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.abs(state).max())


@each
@each_integrator
def test_the_fastest_growing_state_grows_as_its_eigenvalue(changes, integrator):
    full = FullSpectrum(scene(**changes))
    block, dt = full.critical(integrator), 0.02
    state = block.fastest_growing(integrator, dt)
    grown = np.linalg.norm(full.whole.step(integrator, dt) @ state) / np.linalg.norm(state)
    assert grown == pytest.approx(radius(block, integrator, dt), rel=1e-9)


@pytest.mark.parametrize(("integrator", "order"), [("rk45", 5), ("dop853", 8)])
def test_stability_polynomials_are_the_exponential_to_their_order(integrator, order):
    coefficients = spectrum.stability_polynomial(integrator)
    exponential = 1 / np.cumprod([1, *range(1, len(coefficients))])
    np.testing.assert_allclose(coefficients[: order + 1], exponential[: order + 1], rtol=1e-12)
    assert abs(coefficients[order + 1] / exponential[order + 1] - 1) > 1e-3


@pytest.mark.parametrize("integrator", lifted.ADAPTIVE)
@settings(deadline=None, max_examples=40)
@given(omega=frequency, d=damping)
def test_runge_kutta_pairs_are_stable_from_zero_to_their_limit(integrator, omega, d):
    rate = spectrum.wave_rates(np.array([omega]), min(d, 1.9 * omega))[0]
    (limit,) = spectrum.runge_kutta_limits(rate, integrator)
    coefficients = spectrum.stability_polynomial(integrator)[::-1]
    inside = np.abs(np.polyval(coefficients, np.linspace(0, 1, 500) * limit * rate))
    assert inside.max() <= 1 + 1e-11
    assert np.abs(np.polyval(coefficients, 1.001 * limit * rate)) > 1


@settings(deadline=None, max_examples=50)
@given(st.floats(1e-5, 1e5))
def test_a_crossing_is_found_wherever_it_is(place):
    found = spectrum.crossing(lambda step: step > place, 1.0, 1e-8)
    assert found == pytest.approx(place, rel=1e-8)
    assert spectrum.crossing(lambda step: True, place) == 0
    assert spectrum.crossing(lambda step: False, place) == np.inf


@each
def test_exact_jumps_have_no_limit(changes):
    full = FullSpectrum(scene(**changes))
    assert full.limit("exact") == np.inf
    for length in (1e-3, 1, 30):
        assert np.linalg.norm(full.whole.step("exact", length), 2) < 1 + 1e-10
