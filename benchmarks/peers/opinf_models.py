"""opinf: operator inference from snapshots alone.

Follows the opinf documentation's tutorial "Getting Started" (ROM of a basis, a derivative estimator
and a model) and its reference pages opinf.lift, opinf.basis (BasisMulti), opinf.ddt and opinf.roms
(regularisation chosen by fit_regselect_continuous and fit_regselect_discrete, which also ask for
stability over the time to be predicted). SPH is linear in the lifted state (v, e), so the models
have the one operator A.
"""

import warnings
from collections.abc import Iterator

import numpy as np
import opinf

from benchmarks.peers.contender import Contender, Model
from benchmarks.peers.problem import MODES, SAMPLINGS, Problem

REGULARIZERS = list(np.logspace(-14, 0, 15))


def contenders(problem: Problem) -> Iterator[Contender]:
    """A continuous and a discrete model of half a period, and of a whole one."""

    def row(build, integrator, sampling):
        count, stretch = SAMPLINGS[sampling]["count"], sampling.partition(",")[0]
        return Contender(
            "opinf",
            f"operator inference in strain, {count} snapshots of {stretch}",
            integrator,
            lambda: build(problem, sampling),
            MODES,
        )

    for sampling in ("half a period", "a period"):
        yield row(_continuous, "ContinuousModel, RK45, rtol 1e-06, atol 1e-09", sampling)
    for sampling in SAMPLINGS:
        yield row(_discrete, "DiscreteModel, one step a snapshot", sampling)


def _lifter(problem):
    class Strain(opinf.lift.LifterTemplate):
        """(v, ρ) to (v, e) and back, for one state or one a column."""

        @staticmethod
        def lift(states):
            velocity, density = np.split(states, 2)
            return np.concatenate([velocity, (problem.density0 / density.T - 1).T])

        @staticmethod
        def unlift(lifted_states):
            velocity, strain = np.split(lifted_states, 2)
            return np.concatenate([velocity, (problem.density0 / (1 + strain.T)).T])

    return Strain()


def _rom(problem, model, **parts):
    basis = opinf.basis.BasisMulti([opinf.basis.PODBasis(num_vectors=MODES) for _ in range(2)])
    return opinf.ROM(model, lifter=_lifter(problem), basis=basis, **parts)


def _training(problem, sampling):
    """Times of the snapshots, and the states (v, ρ), one a column."""
    snapshots = problem.snapshots(sampling)
    fields = [snapshots[f"{field}_snapshots"].T for field in ("velocity", "density")]
    return snapshots["velocity_time"], np.concatenate(fields)


def _start(problem, rom):
    return rom.encode(np.concatenate([problem.scene.velocity0(), problem.density0]))


def _continuous(problem, sampling):
    times, states = _training(problem, sampling)
    solver = opinf.lstsq.L2Solver(regularizer=REGULARIZERS[0])
    rom = _rom(
        problem,
        opinf.models.ContinuousModel("A", solver=solver),
        ddt_estimator=opinf.ddt.UniformFiniteDifferencer(times, "ord6"),
    )
    options = {"method": "RK45", "rtol": 1e-6, "atol": 1e-9}
    with warnings.catch_warnings():
        # Candidates that blow up are tried, told about and dropped.
        warnings.simplefilter("ignore")
        rom.fit_regselect_continuous(
            REGULARIZERS,
            times,
            states,
            test_time_length=problem.scene.duration - times[-1],
            **options,
        )
    start, wanted = _start(problem, rom), problem.scene.error_times

    def prepare(intervals):
        return lambda: rom.model.predict(start, wanted[: intervals + 1], **options)

    return Model(prepare, lambda states: rom.decode(states)[: problem.count].T)


def _discrete(problem, sampling):
    times, states = _training(problem, sampling)
    stride = round((times[1] - times[0]) / problem.scene.error_interval)
    solver = opinf.lstsq.L2Solver(regularizer=REGULARIZERS[0])
    rom = _rom(problem, opinf.models.DiscreteModel("A", solver=solver))
    iterations = problem.intervals // stride
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rom.fit_regselect_discrete(REGULARIZERS, states, num_test_iters=iterations - times.size)
    start = _start(problem, rom)

    def prepare(intervals):
        return lambda: rom.model.predict(start, intervals // stride + 1)

    def velocity(states):
        return rom.decode(states)[: problem.count].T

    return Model(prepare, velocity, iterations, stride)
