"""What a force does between outputs, against adaptive quadrature and closed forms."""

import cmath
import math
import re

import numpy as np
import pytest
from examples import examples
from hypothesis import assume, given
from hypothesis import strategies as st
from scenes import scene
from scipy.integrate import quad_vec

from sphpod.full import lifted
from sphpod.numerics import propagator
from sphpod.numerics.course import Course
from sphpod.numerics.enclosure import REACH, enclose
from sphpod.numerics.expressions import Expression
from sphpod.reduced import lifted_rom
from sphpod.reference import exact
from sphpod.scene.checks import check

DURATION = 2.0
NUMBERS = st.floats(-3, 3).map(lambda x: f"({x!r})")


def expression(text):
    return Expression(text, ("t",), {"T": DURATION})


def follow(text):
    return Course.of(expression(text), DURATION)


# --- Bounds ---------------------------------------------------------------------------------------


def trees(leaves, *operations):
    """Texts of nested operations."""
    return st.recursive(
        leaves,
        lambda inner: st.one_of(
            *(
                st.tuples(st.just(operation), *[inner] * operation.count("{}"))
                for operation in operations
            )
        ).map(lambda parts: parts[0].format(*parts[1:])),
        max_leaves=6,
    )


ANALYTIC = (
    "({} + {})", "({} - {})", "({} * {})", "({} / {})", "(-{})", "sin({})", "cos({})", "exp({})",
    "sqrt({})", "({})**2", "({})**3", "({})**-2", "(2 + sin({}))**1.5", "2**({})",
    "sum(l*{} for l in (1, 3))",
)  # fmt: skip
DECIDED = (
    "abs({})", "({} < {})", "({} <= {})", "({} != {})", "where({}, {}, {})", "({} and {})",
    "({} or not {})", "({} // {})", "({} % {})", "({} // 0.7)", "({} % 1.3)",
)  # fmt: skip
LEAVES = st.one_of(st.just("t"), st.just("t/T"), NUMBERS)


def made(text):
    try:
        return expression(text)
    except ValueError:
        assume(False)


@examples(150)
@given(trees(LEAVES, *ANALYTIC, *DECIDED), st.floats(0, 2), st.floats(0, 10), st.data())
def test_real_values_lie_within_their_bounds(text, low, decades, data):
    high = min(low + 10**-decades, 3.0)
    bounds = enclose(made(text), np.array([low]), np.array([high]))
    # Where t equals a number at an end alone, a comparison is that of all other times.
    inner = st.floats(low, high, exclude_min=True, exclude_max=True)
    times = np.array(data.draw(st.lists(inner, min_size=1, max_size=20)))
    values = made(text)(t=times)
    values = values[np.isfinite(values)]
    assert np.all(bounds.low <= values)
    assert np.all(values <= bounds.high)


@examples(150)
@given(
    trees(LEAVES, *ANALYTIC), st.floats(0, 2), st.floats(0, 10), st.floats(0, 1), st.floats(0, 7)
)
def test_complex_values_lie_within_their_disc(text, low, decades, share, angle):
    function, high = made(text), low + 10**-decades
    bounds = enclose(function, np.array([low]), np.array([high]))
    assume(np.isfinite(bounds.radius[0]))
    names = {
        "sin": cmath.sin,
        "cos": cmath.cos,
        "exp": cmath.exp,
        "sqrt": cmath.sqrt,
        "T": DURATION,
    }
    place = REACH * share * (high - low) / 2 * cmath.exp(1j * angle)
    value = eval(text, names | {"t": (low + high) / 2 + place})
    assert abs(value - bounds.centre[0]) <= bounds.radius[0] * (1 + 1e-9) + 1e-14 * abs(value)


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [
        ("abs(sin(7*t))", 0, 1),
        ("where(t < 1, 3, -2)", -2, 3),
        ("(t % 0.3)*(t // 0.3)", 0, 1.8),
        ("t**2 - 2*t", -4, 4),
        ("1/(t - 1)", -np.inf, np.inf),
        ("sqrt(t - 1)", 0, 1),
        ("t > -1 and not t > 3 or t == 7", 1, 1),
    ],
)
def test_bounds_over_all_of_the_time(text, low, high):
    bounds = enclose(expression(text), np.array([0.0]), np.array([2.0]))
    np.testing.assert_allclose([bounds.low[0], bounds.high[0]], [low, high], rtol=1e-13, atol=1e-13)


# --- Courses --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "integral"),
    [
        ("0", 0),
        ("3", 6),
        ("where(0.51 < t < 0.51 + 1e-9, 1e6, 0)", 1e6 * ((0.51 + 1e-9) - 0.51)),
        ("where(t < 1e-12, 1, 0)", 1e-12),
        ("(t > 1)*(t < 1 + 2**-40)", 2.0**-40),
        ("exp(-((t - 0.53)/1e-6)**2)", 1e-6 * math.sqrt(math.pi)),
        ("1e-3/(1e-6 + (t - 1)**2)", 2 * math.atan(1e3)),
        ("1e200*sin(400*t)", 1e200 * (1 - math.cos(800)) / 400),
        ("1e-200*cos(3*t)", 1e-200 * math.sin(6) / 3),
        ("abs(sin(7*t))", (4 * 2 + 1 - math.cos(14 - 4 * math.pi)) / 7),
        ("t % 0.3", 6 * 0.3**2 / 2 + 0.2**2 / 2),
        ("t // 0.3", 0.3 * 15 + 0.2 * 6),
        ("sqrt(t)", 2 / 3 * 2**1.5),
        ("sqrt(T - t)", 2 / 3 * 2**1.5),
        ("sqrt(abs(t - 0.7))", 2 / 3 * (0.7**1.5 + 1.3**1.5)),
        ("t**0.1", 2**1.1 / 1.1),
        ("1/(t + 1e-3)", math.log(2.001 / 0.001)),
        ("where(t < 1.9, 0, 5)", 0.5),
        ("where(sin(2*pi*1000*t) > 0, 1, 0)", 1),
        ("sum(where(t > l/7, l, 0) for l in range(1, 15))", 30 * 7 - 145),
    ],
)  # fmt: skip
def test_integrals_are_those_in_closed_form(text, integral):
    course = follow(text)
    (force,) = propagator_run(np.zeros((1, 2, 2)), 1, np.array([[1.0, 0.0]]), course, 2)[-1:]
    assert abs(force[0] - integral) <= course.missed + 1e-12 * course.total
    assert abs(force[0] - integral) <= 2e-11 * course.total
    # Of what is a millionth of a second long, rounding of the time leaves no more digits.
    assert course.missed <= (1e-9 if "1e-6" in text else 1e-10) * course.total


def test_polynomials_are_the_force_within_what_they_may_miss():
    for text in (
        "sin(400*t)",
        "exp(-50*(t - 1)**2)*cos(90*t)",
        "abs(sin(40*t))",
        "sqrt(t)/(t + 1e-2)",
    ):
        course = follow(text)
        times = np.random.default_rng(0).uniform(0, DURATION, 20000)
        seen = np.abs(course(times) - course.expression(t=times)).mean() * DURATION
        assert seen <= 1e-11 * course.total
        assert course.missed <= 1e-10 * course.total
        assert course.edges[0] == 0
        assert course.edges[-1] == DURATION
        assert np.all(np.diff(course.edges) > 0)


@pytest.mark.parametrize(
    "text",
    [
        "1/(t - 0.5)", "1/(3*t - 1)", "1/(t**2 - 2)", "sqrt(1 - t)", "1 + sqrt(t - t)",
        "where(sin(t)**2 + cos(t)**2 <= 1, 1, 2)", "where(sin(1e6*t) > 0, 1, -1)", "1/sqrt(t)",
        "sin(1/t)",
    ],
)  # fmt: skip
def test_what_cannot_be_followed_is_not_proved(text):
    assert follow(text).missed == np.inf


def test_a_course_is_made_once():
    assert follow("sin(3*t)") is follow("sin(3*t)")
    assert follow("sin(3*t)") is not Course.of(expression("sin(3*t)"), 1.0)


# --- Models under random forces -------------------------------------------------------------------


@st.composite
def forces(draw):
    """A text, and the times at which quadrature is to be told that something happens."""
    parts, points = [], []
    for _ in range(draw(st.integers(1, 3))):
        size = draw(st.sampled_from([1e-3, 1.0, -2.0]))
        begin = draw(st.floats(0, 1.9))
        width = 10 ** draw(st.floats(-7, 0))
        rate = draw(st.floats(1, 120))
        text, at = draw(
            st.sampled_from(
                [
                    (f"where({begin!r} < t < {begin + width!r}, 1, 0)", [begin, begin + width]),
                    (f"abs(t - {begin!r})", [begin]),
                    (f"abs(sin({rate!r}*t))", np.arange(1, 80) * np.pi / rate),
                    (f"sin({rate!r}*t)", []),
                    (f"where(t < {begin!r}, 0, sin({rate!r}*(t - {begin!r}))*exp(-9*t))", [begin]),
                    (f"t % {1 / rate!r}", np.arange(1, 241) / rate),
                    (
                        f"exp(-((t - {begin!r})/{max(width, 1e-4)!r})**2)",
                        begin + max(width, 1e-4) * np.array([-6, -1, 0, 1, 6]),
                    ),
                    ("0", []),
                ]
            )
        )
        parts.append(f"({size})*({text})")
        points.extend(at)
    return " + ".join(parts), sorted({p for p in points if 0 < p < DURATION})


@st.composite
def models(draw):
    """Blocks, singles and the force on them."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    if draw(st.booleans()):
        coupling, loss = rng.uniform(-20, 20, (2, 5, 5))
        return (coupling - coupling.T - loss @ loss.T / 30)[None], 0, rng.standard_normal((1, 5))
    blocks = np.zeros((4, 2, 2))
    blocks[:, 0, 0] = -rng.choice([0, 1, 60], 4)
    blocks[:3, 0, 1] = rng.uniform(0, 90, 3)
    blocks[:3, 1, 0] = -blocks[:3, 0, 1]
    force = rng.standard_normal((4, 2))
    force[3, 1] = 0
    return blocks, 1, force


def propagator_run(blocks, singles, force, course, outputs, euler_steps=0):
    """From rest, shape (outputs, coordinates)."""
    interval = DURATION / (outputs - 1)
    jumps = propagator.prepare(
        blocks, singles, force[None], interval, outputs, (course,), euler_steps
    )
    state = np.zeros(
        (blocks[0].shape[0] if blocks.shape[-1] > 2 else 2 * len(blocks) - singles, outputs)
    )
    jumps.run(state)
    return state.T


def whole(blocks, singles, force):
    """Matrix and force of all coordinates, every α before the β."""
    if blocks.shape[-1] > 2:
        return blocks[0], force[0]
    count = len(blocks)
    matrix = np.zeros((2 * count, 2 * count))
    for m, block in enumerate(blocks):
        matrix[np.ix_([m, count + m], [m, count + m])] = block
    keep = 2 * count - singles
    return matrix[:keep, :keep], force.T.ravel()[:keep]


def response(matrix, push, text, points, end):
    """∫ exp((end - s) matrix) push f(s) ds by adaptive quadrature, and ∫ |f| ds."""
    values, vectors = np.linalg.eig(matrix)
    driven, function = np.linalg.solve(vectors, push.astype(complex)), expression(text)

    def integrand(s):
        force = function(t=np.array([s]))[0]
        return np.append(np.exp(values * (end - s)) * driven * force, abs(force))

    points = [point for point in points if point < end]
    options = {"epsabs": 1e-15, "epsrel": 1e-12, "limit": 2000, "norm": "max"}
    result, _ = quad_vec(integrand, 0, end, points=points, **options)
    return (vectors @ result[:-1]).real, result[-1].real


@pytest.mark.slow
@examples(10)
@given(models(), forces(), st.sampled_from([2, 3, 12, 201]))
def test_any_force_does_what_quadrature_says(model, force, outputs):
    """It may jump, kink, ring or rest, with outputs coarse or fine."""
    text, points = force
    course = follow(text)
    blocks, singles, profile = model
    matrix, push = whole(blocks, singles, profile)
    found = propagator_run(blocks, singles, profile, course, outputs)
    for row in {(outputs - 1) // 2 or 1, outputs - 1}:
        end = DURATION * row / (outputs - 1)
        expected, size = response(matrix, push, text, points, end)
        scale = np.abs(profile).max() * max(size, 1e-9 * course.total) + 1e-300
        np.testing.assert_allclose(found[row], expected, rtol=0, atol=1e-10 * scale)
    assert course.missed <= 1e-10 * course.total


@examples(12)
@given(models(), forces(), forces(), st.sampled_from([2, 12, 201]), st.sampled_from([0, 40]))
def test_terms_add_up(model, one, other, outputs, euler_steps):
    """Each with its own profile."""
    blocks, singles, profile = model
    first, second = follow(one[0]), follow(other[0])
    alone = propagator_run(blocks, singles, profile, first, outputs, euler_steps)
    alone = alone + propagator_run(
        blocks, singles, 2 * profile[:, ::-1] * (profile != 0), second, outputs, euler_steps
    )
    interval = DURATION / (outputs - 1)
    both = np.stack([profile, 2 * profile[:, ::-1] * (profile != 0)])
    jumps = propagator.prepare(
        blocks, singles, both, interval, outputs, (first, second), euler_steps
    )
    state = np.zeros(alone.shape[::-1])
    jumps.run(state)
    size = max(np.abs(alone).max(), 1e-3 * (first.total + second.total))
    np.testing.assert_allclose(state.T, alone, rtol=0, atol=2e-11 * size)


def test_explicit_euler_sees_a_force_that_begins_behind_a_step_at_the_next():
    blocks, profile = np.diag([-1.0, -2.0])[None], np.array([[1.0, 0.5]])
    late = "where(0.5 < t < 1, 1, 0)"
    found = propagator_run(blocks, 0, profile, follow(late), 21, 40)
    dt, state = DURATION / 800, np.zeros(2)
    values = expression(late)(t=np.arange(800) * dt)
    for step in range(800):
        state = state + dt * (blocks[0] @ state + profile[0] * values[step])
    np.testing.assert_allclose(found[-1].ravel(), state, rtol=1e-12)


@examples(12)
@given(models(), forces(), st.sampled_from([2, 3, 21]), st.sampled_from([40, 300]))
def test_explicit_euler_takes_the_force_of_its_own_steps(model, force, outputs, euler_steps):
    blocks, singles, profile = model
    matrix, push = whole(blocks, singles, profile)
    count = (outputs - 1) * euler_steps
    dt, state = DURATION / count, np.zeros(len(matrix))
    values = expression(force[0])(t=np.arange(count) * dt)
    states = [state]
    for step in range(count):
        state = state + dt * (matrix @ state + push * values[step])
        states.append(state)
    assume(np.abs(states).max() < 1e3 * (1 + np.abs(values).max()))
    found = propagator_run(blocks, singles, profile, follow(force[0]), outputs, euler_steps)
    size = np.abs(states).max() + dt * np.abs(values).max()
    np.testing.assert_allclose(found, states[::euler_steps], rtol=0, atol=1e-10 * size)


# --- Scenes ---------------------------------------------------------------------------------------

PULSE = {
    "duration": 4,
    "initial_velocity": 0,
    "force": {"time": "where(0.51 < t < 0.56, 1e-2, 0)", "profile": "sin(2*pi*x/L)"},
    "time_step": 5e-4,
    "error_interval": 0.1,
}
GRADED = {
    "duration": 4,
    "initial_velocity": 0,
    "initial_density": "1 + 0.3*sin(2*pi*x/L)",
    "youngs_modulus": "0.1 + 0.05*cos(2*pi*x/L)",
    "force": {"time": "2e-2*sin(40*t)", "profile": "sin(2*pi*x/L)"},
    "error_interval": 0.25,
}
SCENES = {
    "pulse": (PULSE, [0.51, 0.56]),
    "pulse, coarse": (PULSE | {"error_interval": 2, "damping": 1}, [0.51, 0.56]),
    "short pulse": (
        PULSE | {"force": {"time": "where(0.51 < t < 0.51001, 50, 0)", "profile": "x"}},
        [0.51, 0.51001],
    ),
    "pulse on graded": (
        GRADED | {"force": PULSE["force"], "damping": "1 + sin(2*pi*x/L)", "error_interval": 1},
        [0.51, 0.56],
    ),
    "graded": (GRADED, []),
    "graded, fine": (GRADED | {"error_interval": 0.02}, []),
    "jittered": (GRADED | {"positions": {"jitter": 0.2}}, []),
}
each_scene = pytest.mark.parametrize(("changes", "points"), SCENES.values(), ids=SCENES)


def true_fields(case, points, row):
    """Velocity and strain at an output, by the eigenvectors of the full operator."""
    scales = np.concatenate(lifted.energy_weights(case))
    _, (profile,) = case.force_values(np.zeros(1))
    push = scales * np.concatenate([profile, np.zeros(case.particle_count)])
    matrix, end = lifted.operator(case).toarray(), case.error_times[row]
    values, vectors = np.linalg.eig(matrix)
    driven = np.linalg.solve(vectors, push.astype(complex))
    times, weights = np.polynomial.legendre.leggauss(20)
    edges = np.unique([*(p for p in points if p < end), *np.linspace(0, end, int(60 * end) + 2)])
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    times = middle[:, None] + half[:, None] * times
    shares = half[:, None] * weights * case.forces[0].factors[0](t=times)
    powers = np.exp((end - times.ravel())[:, None] * values)
    return (vectors @ (driven * (shares.ravel() @ powers))).real / scales


@each_scene
def test_full_and_reduced_models_are_exact_whatever_the_force_does(changes, points):
    case = scene(**changes)
    full = lifted.solve(case, "exact")
    every = np.eye(case.particle_count)
    reduced = lifted_rom.LiftedModel(case, every, every, 0).prepare("lifted_exact").solve().fields()
    for row in (1, case.error_times.size // 2, case.error_times.size - 1):
        expected = true_fields(case, points, row)
        atol = 1e-10 * max(np.abs(expected).max(), 1e-6)
        for fields in (full, reduced):
            both = np.concatenate([fields["velocity"][row], fields["strain"][row]])
            np.testing.assert_allclose(both, expected, rtol=0, atol=atol)


@each_scene
@pytest.mark.parametrize("integrator", lifted.ADAPTIVE)
def test_adaptive_steps_pass_no_pulse(changes, points, integrator):
    case = scene(**changes)
    found = lifted.solve(case, integrator, tolerance=1e-9)
    truth = lifted.solve(case, "exact")
    for field in ("velocity", "strain"):
        scale = np.abs(truth[field]).max()
        np.testing.assert_allclose(found[field], truth[field], rtol=0, atol=1e-5 * scale)


@pytest.mark.parametrize("damping", [0, 1.5])
@pytest.mark.parametrize(("begin", "end"), [(0.51, 0.56), (0.51, 0.51 + 1e-5), (1.0, 3.95)])
def test_the_exact_solution_of_a_driven_mode_is_that_in_closed_form(damping, begin, end):
    """v' = -d v + c e' + sin(kx) f, e' = v': an oscillator that a pulse sets going."""
    time = f"where({begin!r} < t < {end!r}, 1e-2, 0)"
    force = {"time": time, "profile": "sin(2*pi*x/L)"}
    case = scene(**PULSE | {"force": force, "damping": damping})
    solution, t = exact.solve(case), case.error_times[:, None]
    k = 2 * np.pi
    root = np.sqrt(0.1 * k**2 - damping**2 / 4)

    def step(s):
        """x of x'' + d x' + ω² x = H(s)'s integral: velocity that a constant force has given."""
        s = np.maximum(s, 0)
        return np.exp(-damping / 2 * s) * np.sin(root * s) / root

    velocity = 1e-2 * (step(t - begin) - step(t - end)) * np.sin(k * case.positions)
    size = 1e-2 * (end - begin)
    np.testing.assert_allclose(solution["velocity"], velocity, rtol=0, atol=1e-9 * size)


def test_a_uniform_force_gives_its_integral_to_all_particles():
    case = scene(**PULSE | {"force": "where(0.51 < t < 0.51 + 1e-6, 1e3, 0)", "damping": 2})
    velocity = exact.solve(case)["velocity"]
    t = case.error_times[:, None]
    width = (0.51 + 1e-6) - 0.51
    after = 1e3 * width * np.exp(-2 * (t - 0.51 - width / 2)) * (t > 0.52)
    np.testing.assert_allclose(velocity, np.broadcast_to(after, velocity.shape), rtol=1e-9)


@pytest.mark.parametrize(
    ("time", "at"),
    [
        ("1/(t - 0.503)", "0.503"),
        ("1e-9/(3*t - 1)", "0.333333"),
        ("(t - 0.1234567)**-2", "0.123457"),
    ],
)
def test_a_force_with_a_pole_between_outputs_is_refused(time, at):
    with pytest.raises(ValueError, match=rf"^scene test: force = {re.escape(time)}: .* t = {at}$"):
        check(scene(force=time))


@pytest.mark.slow
def test_a_force_that_cannot_be_followed_is_reported_once(caplog):
    case = scene("rough", force="where(sin(1e6*t) > 0, 1e-3, -1e-3)")
    for _ in range(2):
        lifted.solve(case, "exact")
    (record,) = caplog.records
    assert record.getMessage().startswith("scene rough: force = where(sin(1e6*t) > 0")
    assert record.getMessage().endswith("no error is certified")


@pytest.mark.parametrize(
    "text", ["cos(20*t)", "where(t < 0.7, t**2, -1)", "exp(-((t - 1)/0.01)**2)"]
)
def test_integrals_of_pieces_are_those_of_the_force(text) -> None:
    course = follow(text)
    for edge, integral in zip(course.edges[1:], course.integrals, strict=True):
        expected, _ = quad_vec(
            lambda t: float(expression(text)(t=np.array(t))), 0, edge, points=course.edges[1:-1]
        )
        assert integral == pytest.approx(expected, abs=1e-9)
