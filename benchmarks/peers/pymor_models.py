"""pyMOR: full SPH as its models, and their reduction.

Follows the pyMOR documentation's tutorials "Binding an external PDE solver to pyMOR" (operators of
one's own), "Building a Reduced Basis" (pod, InstationaryRBReductor), the page of
pymor.algorithms.ei with the demo burgers_ei (explicit Euler, interpolation of nonlinear operators;
operators that are sums are interpolated part by part), and, for the lifted equations, the pages of
ImplicitMidpointTimeStepper and QuadraticHamiltonianModel with the demo symplectic_wave_equation.

Modes are taken of each field by itself and put together, 12 of each, as in this project's models.
"""

from collections.abc import Iterator

import numpy as np
from pymor.algorithms.ei import qdeim
from pymor.algorithms.pod import pod
from pymor.algorithms.symplectic import psd_cotangent_lift
from pymor.algorithms.timestepping import ExplicitEulerTimeStepper, ImplicitMidpointTimeStepper
from pymor.core.logger import set_log_levels
from pymor.models.basic import InstationaryModel
from pymor.models.symplectic import BaseQuadraticHamiltonianModel, QuadraticHamiltonianModel
from pymor.operators.block import BlockDiagonalOperator
from pymor.operators.constructions import ConcatenationOperator, IdentityOperator, LincombOperator
from pymor.operators.ei import EmpiricalInterpolatedOperator
from pymor.operators.interface import Operator
from pymor.operators.numpy import NumpyMatrixOperator
from pymor.reductors.basic import InstationaryRBReductor
from pymor.reductors.symplectic import QuadraticHamiltonianRBReductor
from pymor.vectorarrays.numpy import NumpyVectorSpace
from scipy.sparse import csr_array, diags_array, eye_array, vstack

from benchmarks.peers.contender import CONVERGED, EULER, LIFTED_EULER, LONG, Contender, Model
from benchmarks.peers.problem import MODES, Problem
from benchmarks.peers.scipy_models import strain_operator

POINTS = 28
"""Interpolation points for each nonlinearity: the best of 12, 14, … to 80 for this scene."""


def contenders(problem: Problem) -> Iterator[Contender]:
    """SPH in density, full, projected and interpolated; SPH in strain, full and projected."""
    set_log_levels({"pymor": "ERROR", "benchmarks": "ERROR"})
    scene = problem.scene
    euler = f"explicit Euler, Δt = {scene.time_step:g} s"
    midpoint = f"implicit midpoint, Δt = {scene.error_interval:g} s"

    def row(model, integrator, build, *arguments, **settings):
        return Contender("pymor", model, integrator, lambda: build(problem, *arguments), **settings)

    yield row("full SPH", euler, _density, None, check=EULER, part=LONG)
    yield row("POD-Galerkin", euler, _density, _project, modes=MODES, part=LONG)
    interpolated = f"POD-Galerkin, Q-DEIM of {POINTS} points"
    yield row(interpolated, euler, _density, _interpolate, modes=MODES, part=LONG)

    full, reduced = "full SPH in strain", "POD-Galerkin in strain"
    explicit = scene.step_count, ExplicitEulerTimeStepper
    yield row(full, euler, _strain, *explicit, None, check=LIFTED_EULER, part=LONG)
    yield row(reduced, euler, _strain, *explicit, MODES, modes=MODES, part=LONG)
    implicit = problem.intervals, ImplicitMidpointTimeStepper
    yield row(full, midpoint, _strain, *implicit, None, check=CONVERGED)
    yield row(reduced, midpoint, _strain, *implicit, MODES, modes=MODES)
    yield row("full SPH, Hamiltonian", midpoint, _hamiltonian, None, check=CONVERGED, part=LONG)
    yield row("symplectic Galerkin, cotangent lift", midpoint, _hamiltonian, MODES, modes=MODES)


class Stress(Operator):
    """c (ρ0/ρ - 1) of the densities behind the first ``skipped`` components of the state."""

    linear = False

    def __init__(self, density0, modulus, skipped):
        self.__auto_init(locals())
        self.source = NumpyVectorSpace(skipped + density0.size)
        self.range = NumpyVectorSpace(density0.size)

    def apply(self, U, mu=None):
        density = U.to_numpy()[self.skipped :]
        return self.range.make_array(self.modulus[:, None] * (self.density0[:, None] / density - 1))

    def restricted(self, dofs):
        return Stress(self.density0[dofs], self.modulus[dofs], 0), self.skipped + dofs


class Thinning(Operator):
    """ρ²/ρ0 ∘ G v of some particles, from the velocities that G takes and their densities."""

    linear = False

    def __init__(self, gradient, density0):
        self.__auto_init(locals())
        self.source = NumpyVectorSpace(gradient.shape[1] + density0.size)
        self.range = NumpyVectorSpace(density0.size)

    def apply(self, U, mu=None):
        state, count = U.to_numpy(), self.gradient.shape[1]
        velocity, density = state[:count], state[count:]
        return self.range.make_array(
            density * density / self.density0[:, None] * (self.gradient @ velocity)
        )

    def restricted(self, dofs):
        rows = self.gradient[dofs]
        taken = np.unique(rows.nonzero()[1])
        restricted = Thinning(rows[:, taken].toarray(), self.density0[dofs])
        return restricted, np.concatenate([taken, self.gradient.shape[1] + dofs])


class Rates(Operator):
    """Minus the rates of change of the state (v, ρ), in one operator."""

    linear = False

    def __init__(self, gradient, density0, modulus):
        self.__auto_init(locals())
        self.source = self.range = NumpyVectorSpace(2 * density0.size)

    def apply(self, U, mu=None):
        state, count = U.to_numpy(), self.density0.size
        velocity, density = state[:count], state[count:]
        density0, result = self.density0[:, None], np.empty_like(state)
        stress = self.modulus[:, None] * (1 - density0 / density)
        result[:count] = (self.gradient @ stress) / density0
        result[count:] = density * density / density0 * (self.gradient @ velocity)
        return self.range.make_array(result)


def _basis(space, *fields):
    """Modes of each field's snapshots (n, N) by itself, as vectors of the whole state."""
    basis = space.empty()
    for number, snapshots in enumerate(fields):
        modes, _ = pod(NumpyVectorSpace.make_array(snapshots.T), modes=MODES)
        whole = np.zeros((space.dim, len(modes)))
        count = space.dim // len(fields)
        whole[number * count : (number + 1) * count] = modes.to_numpy()
        basis.append(space.make_array(whole))
    return basis


def _model(problem, fom, steps, stepper, velocity):
    """``stepper(n)`` makes n steps; ``velocity(U)`` are velocities, one a column."""

    def prepare(intervals):
        nt = steps * intervals // problem.intervals
        # Hamiltonian models want to be told twice.
        told = {"nt": nt} if isinstance(fom, BaseQuadraticHamiltonianModel) else {}
        duration = intervals * problem.scene.error_interval
        part = fom.with_(T=duration, time_stepper=stepper(nt), num_values=intervals + 1, **told)
        return part.solve

    return Model(prepare, lambda U: velocity(U).T, steps)


def _instationary(problem, operator, second, time_stepper):
    """Model of the operator, from the initial velocity and the second field's initial state."""
    start = np.concatenate([problem.scene.velocity0(), second])
    return InstationaryModel(
        T=problem.scene.duration,
        initial_data=operator.source.make_array(start[:, None]),
        operator=operator,
        rhs=None,
        time_stepper=time_stepper,
    )


def _reduced(problem, fom, second):
    """Galerkin projection on 12 modes of velocity and of the second field (n, N)."""
    velocity = problem.snapshots("half a period")["velocity_snapshots"]
    reductor = InstationaryRBReductor(fom, _basis(fom.solution_space, velocity, second))
    return reductor.reduce(), lambda U: reductor.reconstruct(U).to_numpy()[: problem.count]


def _density(problem, reduce):
    """SPH in velocity and density; ``reduce`` makes its reduced model, or is None."""
    steps = problem.scene.step_count
    fom = _instationary(
        problem,
        Rates(problem.gradient, problem.density0, problem.modulus),
        problem.density0,
        ExplicitEulerTimeStepper(steps),
    )
    if reduce is None:
        model, velocity = fom, lambda U: U.to_numpy()[: problem.count]
    else:
        model, velocity = reduce(problem, fom)
    return _model(problem, model, steps, ExplicitEulerTimeStepper, velocity)


def _project(problem, fom):
    return _reduced(problem, fom, problem.snapshots("half a period")["density_snapshots"])


def _interpolate(problem, fom):
    """Each nonlinearity is interpolated by itself; the linear operators around them are not."""
    none, unit = csr_array((problem.count,) * 2), eye_array(problem.count)
    pull = diags_array(-1 / problem.density0) @ problem.gradient
    snapshots = problem.snapshots("half a period")
    fields = [snapshots[f"{field}_snapshots"].T for field in ("velocity", "density")]
    states = fom.solution_space.make_array(np.concatenate(fields))
    parts = (
        (Stress(problem.density0, problem.modulus, problem.count), [pull, none]),
        (Thinning(problem.gradient, problem.density0), [none, unit]),
    )
    rates = []
    for nonlinear, linear in parts:
        points, basis, _ = qdeim(
            nonlinear.apply(states), POINTS, atol=0.0, rtol=0.0, pod_options={"method": "qr_svd"}
        )
        interpolated = EmpiricalInterpolatedOperator(nonlinear, points, basis, triangular=False)
        outer = NumpyMatrixOperator(vstack(linear, format="csr"))
        rates.append(ConcatenationOperator([outer, interpolated]))
    return _project(problem, fom.with_(operator=LincombOperator(rates, [1.0, 1.0])))


def _strain(problem, steps, stepper, modes):
    """SPH in velocity and strain, with so many modes of each or in full."""
    fom = _instationary(
        problem,
        NumpyMatrixOperator(-strain_operator(problem)),
        np.zeros(problem.count),
        stepper(steps),
    )
    if modes is None:
        model, velocity = fom, lambda U: U.to_numpy()[: problem.count]
    else:
        density = problem.snapshots("half a period")["density_snapshots"]
        model, velocity = _reduced(problem, fom, problem.density0 / density - 1)
    return _model(problem, model, steps, stepper, velocity)


def _hamiltonian(problem, modes):
    """Displacement u and velocity, H = (v·v + u·K u)/2 with K = -diag(1/ρ0) G diag(c) G."""
    scene, space = problem.scene, NumpyVectorSpace(problem.count)
    pull = diags_array(-1 / problem.density0) @ problem.gradient
    stiffness = (pull @ diags_array(problem.modulus) @ problem.gradient).tocsr()
    energy = BlockDiagonalOperator([NumpyMatrixOperator(stiffness), IdentityOperator(space)])

    def states(displacement, velocity):
        """From rows (n, N)."""
        return energy.source.make_array(
            [space.make_array(displacement.T), space.make_array(velocity.T)]
        )

    velocity0 = scene.velocity0()[None]
    fom = QuadraticHamiltonianModel(
        scene.duration, states(np.zeros_like(velocity0), velocity0), energy, nt=problem.intervals
    )
    if modes is None:
        model, velocity = fom, lambda U: U.blocks[1].to_numpy()
    else:
        velocities = problem.snapshots("half a period")["velocity_snapshots"]
        snapshots = states(problem.displacements("half a period"), velocities)
        reductor = QuadraticHamiltonianRBReductor(fom, psd_cotangent_lift(snapshots, 2 * modes))
        model = reductor.reduce()
        velocity = lambda U: reductor.reconstruct(U).blocks[1].to_numpy()  # noqa: E731
    return _model(problem, model, problem.intervals, ImplicitMidpointTimeStepper, velocity)
