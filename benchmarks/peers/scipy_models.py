"""SciPy: full SPH over sparse products, with solve_ivp and as a plain loop.

Follows the reference pages of scipy.integrate.solve_ivp (Runge-Kutta pairs for problems that are
not stiff, DOP853 where precision is wanted, tolerances scaled to the state) and of scipy.sparse
(csr_array for products with vectors).
"""

from collections.abc import Iterator

import numpy as np
from scipy.integrate import solve_ivp
from scipy.sparse import block_array, diags_array

from benchmarks.peers.contender import CONVERGED, EULER, LONG, Check, Contender, Model
from benchmarks.peers.problem import Problem

SETTINGS = (
    # About as accurate in time as the paper's explicit Euler, and two that are more so.
    ("RK23", 1e-4, 1e-7, Check("exact_in_time", 5e-2)),
    ("RK45", 1e-5, 1e-8, CONVERGED),
    ("DOP853", 1e-6, 1e-9, CONVERGED),
)
"""Method, relative and absolute tolerance; velocities are of size 1e-3, strains of 3e-3."""


def contenders(problem: Problem) -> Iterator[Contender]:
    """solve_ivp in density and in strain, and explicit Euler as a loop."""
    for method, rtol, atol, check in SETTINGS:
        yield Contender(
            "scipy",
            "full SPH, sparse",
            f"solve_ivp {method}, rtol {rtol:g}, atol {atol:g}",
            lambda method=method, rtol=rtol, atol=atol: _adaptive(
                problem, _density_rates(problem), problem.density0, method, rtol, atol
            ),
            check=check,
        )
    yield Contender(
        "scipy",
        "full SPH in strain, sparse",
        "solve_ivp DOP853, rtol 1e-06, atol 1e-09",
        lambda: _adaptive(
            problem, _strain_rates(problem), np.zeros(problem.count), "DOP853", 1e-6, 1e-9
        ),
        check=CONVERGED,
    )
    yield Contender(
        "scipy",
        "full SPH, sparse",
        f"explicit Euler loop, Δt = {problem.scene.time_step:g} s",
        lambda: _loop(problem),
        check=EULER,
        part=LONG,
    )


def _density_rates(problem):
    """Rates of the state (v, ρ), one behind the other."""
    gradient, density0, modulus, count = (
        problem.gradient,
        problem.density0,
        problem.modulus,
        problem.count,
    )

    def rates(t, state):
        velocity, density = state[:count], state[count:]
        result = np.empty_like(state)
        result[:count] = (gradient @ (modulus * (density0 / density - 1))) / density0
        result[count:] = -(density**2) / density0 * (gradient @ velocity)
        return result

    return rates


def strain_operator(problem: Problem):
    """Matrix (2N, 2N) of the lifted equations for the state (v, e), sparse [1/s]."""
    pull = diags_array(1 / problem.density0) @ problem.gradient @ diags_array(problem.modulus)
    return block_array([[None, pull], [problem.gradient, None]], format="csr")


def _strain_rates(problem):
    operator = strain_operator(problem)
    return lambda t, state: operator @ state


def _adaptive(problem, rates, second, method, rtol, atol):
    times = problem.scene.error_times
    start = np.concatenate([problem.scene.velocity0(), second])

    def prepare(intervals):
        wanted = times[: intervals + 1]
        return lambda: solve_ivp(
            rates, (0, wanted[-1]), start, method, t_eval=wanted, rtol=rtol, atol=atol
        )

    return Model(prepare, lambda result: result.y[: problem.count].T)


def _loop(problem):
    """As sphpod.timing.sparse_loop, with outputs."""
    scene, gradient, modulus, density0 = (
        problem.scene,
        problem.gradient,
        problem.modulus,
        problem.density0,
    )
    dt = scene.time_step

    def prepare(intervals):
        kept = np.empty((intervals + 1, problem.count))

        def run():
            velocity, density = scene.velocity0(), density0
            kept[0] = velocity
            for row in range(1, intervals + 1):
                for _ in range(scene.error_stride):
                    pull = (gradient @ (modulus * (1 - density0 / density))) / density0
                    density = density - dt * density**2 / density0 * (gradient @ velocity)
                    velocity = velocity - dt * pull
                kept[row] = velocity
            return kept

        return run

    return Model(prepare, np.asarray, scene.step_count)
