"""The time steps from which runs really grow, beside those that `stability.spectrum` predicts.

The most restrictive mode is seeded: the eigenvector of its eigenvalue, in both phases. Any sum of
squares over both changes by |μ|² a step, without oscillation, so that few steps show the growth
rate ln(E_n/E_0)/(2 n Δt) to rounding. The runs are those of the models themselves; the seed is
small, so that those with nonlinear terms do not feel them.

Long: the runs of every model are prepared in one form, by which they are compared.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import meanings
from sphpod.reduced import lifted_rom, rom
from sphpod.scene.scene import Scene
from sphpod.stability.spectrum import (
    FullSpectrum,
    crossing,
    euler_growth_rates,
    euler_limits,
    neutral,
)
from sphpod.studies.study import WITHOUT_FREE_ENDS, Dataset, Drawing, Study, samplings, scenes

March = Callable[[np.ndarray, float, int, int], np.ndarray]
"""``march(state, time_step, stride, outputs)``: states after every ``stride`` steps, the first one
included, shape (outputs + 1, size)."""

SEED = 1e-5
"""Largest strain of a seed, whose square is little beside 1."""

LINEAR = 1e-2
"""Largest strain of a nonlinear model's runs; beyond, growth may saturate."""

GROWS = 1e-10
"""Logarithm of the amplitude's growth in a step that is more than the rounding of a seed."""

ACCURACY = 1e-5
"""Relative accuracy of a measured time step."""

STEPS, PAIR_STEPS, DRIFTING_STEPS = 1000, 50, 20
"""Steps of a run; of one of scipy's pairs, whose steps cost more; and of the paper's reduced
models, whose growth changes the more, the longer they drift from a rest that is no equilibrium."""

JUMPS, LONGEST = 7, 100
"""Exact jumps that are tried, from the scene's step to so many of its durations."""

RESULTS = (
    "contender_time_step",
    "predicted_time_step",
    "measured_time_step",
    "predicted_growth_rate",
    "measured_growth_rate",
)

MODELS = ("original", "frozen10")
"""The paper's reduced models; the linearized one has the operator of the frozen ones."""


quiet = np.errstate(over="ignore", invalid="ignore", divide="ignore")
"""Runs that leave all bounds are expected here."""


# --- Runs of the models ---------------------------------------------------------------------------


def march_full(scene: Scene, integrator: str, paper: bool = False) -> March:
    """Runs of the lifted full model in scaled fields (2N,), or of the paper's full SPH.

    The adaptive integrators are held to fixed steps, by an infinite tolerance. A force, which
    changes no growth, is left out. Where full SPH leaves the linear range it is not a number.
    """
    scene = unforced(scene)
    scales = np.concatenate(lifted.energy_weights(scene))
    count = scene.particle_count

    def run_fixed(state, time_step, stride, outputs):
        case = _shown(scene, time_step, stride, outputs)
        start = state[:count], state[count:]
        if paper:
            start = start[0], lifted.density(scene, start[1])
            run = sph.prepare(case, np.arange(outputs + 1) * stride, start=start)
            velocity, density = run.run(watch=False).state
            strain = lifted.strain(scene, density)
            velocity[_beyond(strain)] = np.nan
        else:
            velocity, strain = lifted.prepare(case, integrator, start=start).run(watch=False).state
        return np.concatenate([velocity, strain], axis=1)

    def march(state, time_step, stride, outputs):
        run = partial(run_pair, scene, integrator) if integrator in lifted.ADAPTIVE else run_fixed
        return run(state / scales, time_step, stride, outputs) * scales

    return odd(march) if paper else march


def run_pair(scene, integrator, state, time_step, stride, outputs):
    """States (outputs + 1, 2 N) of one of scipy's pairs, held to steps by an infinite tolerance."""
    from scipy import integrate

    solver = getattr(integrate, integrator.upper())(
        lifted.rates(scene), 0, state, np.inf, first_step=time_step, max_step=time_step,
        atol=np.inf,
    )  # fmt: skip
    states = [state]
    for _ in range(outputs):
        for _ in range(stride):
            solver.step()
        states.append(solver.y)
    return np.array(states)


def march_galerkin(model: rom.ReducedModel) -> March:
    """Runs of a nonlinear reduced model about its state at rest, in its coordinates (kv + kρ,).

    Where they leave the linear range they are not a number.
    """
    kv = len(model.velocity_modes)
    rest = model.density_modes @ model.scene.density0()

    def march(state, time_step, stride, outputs):
        case = replace(model, scene=replace(unforced(model.scene), time_step=time_step))
        start = state[:kv], rest + state[kv:]
        velocity, density = case.prepare(np.arange(outputs + 1) * stride, start).run().state
        moved = (density - rest) @ model.density_modes / model.scene.density0()
        velocity[_beyond(moved)] = np.nan
        return np.concatenate([velocity, density - rest], axis=1)

    return odd(march)


def _beyond(strain):
    """Outputs (outputs, N) from the first on that has left the linear range."""
    return np.logical_or.accumulate(~(np.abs(strain).max(axis=1) <= LINEAR))


def odd(march: March) -> March:
    """Half the difference of runs from a state and from its negative.

    It is linear in the state but for third order, and free of what runs do by themselves: a rest
    that is no exact equilibrium, as of an initial density projected on modes.
    """

    @quiet
    def difference(*arguments):
        state, *others = arguments
        return (march(state, *others) - march(-state, *others)) / 2

    return difference


def march_lifted(model: lifted_rom.LiftedModel, method: str) -> March:
    """Runs of a lifted reduced model, in the coordinates of its modes (kv + ke,)."""
    kv, scene = len(model.velocity_modes), unforced(model.scene)

    @quiet
    def march(state, time_step, stride, outputs):
        case = _shown(scene, time_step, stride, outputs)
        run = replace(model, scene=case).prepare(method, (state[:kv], state[kv:])).run()
        return np.concatenate(run.coordinates(), axis=1)

    return march


def _shown(scene, time_step, stride, outputs):
    """The scene with so many outputs after the start, each after so many steps."""
    interval = stride * time_step
    return replace(scene, time_step=time_step, error_interval=interval, duration=outputs * interval)


def unforced(scene: Scene) -> Scene:
    """The scene without its force."""
    return replace(scene, forces=())


# --- Growth of a run ------------------------------------------------------------------------------


@quiet
def growth(march: March, seed: np.ndarray, time_step: float, steps: int) -> float:
    """Logarithm of the growth of a seed's amplitude in a step; infinite if it left all bounds.

    Parameters
    ----------
    march : callable
    seed : complex array, shape (size,)
        Both phases are run.
    time_step : float
        Δt [s].
    """
    phases = [phase for phase in (seed.real, seed.imag) if phase.any()]
    ends = np.array([march(phase, time_step, steps, 1)[-1] for phase in phases])
    rate = np.log(np.sum(ends**2) / np.vdot(seed, seed).real) / (2 * steps)
    return float(rate) if rate < np.inf else np.inf


@quiet
def late_growth(states: np.ndarray, stride: int) -> float:
    """Logarithm of the growth of the amplitude in a step, over the second half of a run.

    Parameters
    ----------
    states : array, shape (outputs, size)
        Of these, the first ones count that are finite and whose squares floating point holds.
    stride : int
        Steps from output to output.
    """
    energy = np.einsum("ts,ts->t", states, states)
    lost = ~((energy > 1e-280) & (energy < 1e280))
    last = (int(np.argmax(lost)) if lost.any() else len(lost)) - 1
    if last < 1:
        return np.inf
    middle = last // 2
    return float(np.log(energy[last] / energy[middle]) / (2 * stride * (last - middle)))


@dataclass(frozen=True)
class Contender:
    """A model and an integrator: how they run, and what their spectrum says.

    Attributes
    ----------
    mode_count : int
        0 for a full model.
    march : callable
    steps : int
        Steps of a run.
    seed : callable
        Most restrictive mode at a time step, complex, (size,).
    limit, growth_rate : float
        Largest stable step [s]: infinite if there is none, 0 if no step is stable; and, for that
        case, the growth rate at the scene's step [1/s].
    fastest : float
        Largest size of an eigenvalue [1/s].
    """

    name: str
    integrator: str
    mode_count: int
    march: March
    steps: int
    seed: Callable[[float], np.ndarray]
    limit: float
    growth_rate: float
    fastest: float

    def measure(self, scene: Scene) -> dict[str, Any]:
        """Predictions beside measurements, by the names of their arrays."""
        row: dict[str, Any] = dict.fromkeys(RESULTS, np.nan) | {
            "contender": self.name,
            "integrator": self.integrator,
            "contender_mode_count": self.mode_count,
        }
        if self.limit > 0:
            measured = self._longest_jump(scene) if np.isinf(self.limit) else self._time_step()
            return row | {"predicted_time_step": self.limit, "measured_time_step": measured}
        dt = scene.time_step
        return row | {
            "contender_time_step": dt,
            "predicted_growth_rate": self.growth_rate,
            "measured_growth_rate": growth(self.march, self.seed(dt), dt, self.steps) / dt,
        }

    def _time_step(self):
        """Time step from which runs grow, NaN if all do; the search knows no prediction."""

        def grows(time_step):
            return growth(self.march, self.seed(time_step), time_step, self.steps) > GROWS

        return crossing(grows, 1 / self.fastest, ACCURACY) or np.nan

    def _longest_jump(self, scene):
        """Shortest jump that grows, of all waves at random; infinite if none does."""
        state = np.random.default_rng(0).standard_normal(self.seed(scene.time_step).size)
        for length in np.geomspace(scene.time_step, LONGEST * scene.duration, JUMPS):
            # The exponential's rounding is proportional to the angle that a wave turns by.
            angle = max(1, self.fastest * length)
            if growth(self.march, state, length, 1) > GROWS * angle:
                return length
        return np.inf


def _small(scene, seed, velocity, strain):
    """The seed with a largest strain, or velocity over that of waves, of SEED."""
    speed = np.sqrt(scene.modulus() / scene.density0())
    return seed * (SEED / np.maximum(np.abs(velocity) / speed, np.abs(strain)).max())


# --- The study ------------------------------------------------------------------------------------


def full(scene: Scene) -> Arrays:
    """Predicted and measured limits of the full models.

    Returns
    -------
    dict
        contender (sph, lifted_full), integrator and contender_mode_count (0), (contenders,), and
        what `STUDY` describes. Time steps are infinite for exact jumps; where every step grows,
        growth rates are those at contender_time_step [s].
    """
    spectrum = FullSpectrum(scene)
    scales = np.concatenate(lifted.energy_weights(scene))

    def contender(name, integrator):
        block = spectrum.critical(integrator)

        def seed(time_step):
            mode = block.fastest_growing(integrator, time_step)
            return _small(scene, mode, *np.split(mode / scales, 2))

        return Contender(
            name,
            integrator,
            0,
            march_full(scene, integrator, paper=name == "sph"),
            PAIR_STEPS if integrator in lifted.ADAPTIVE else STEPS,
            seed,
            spectrum.limit(integrator),
            spectrum.growth_rate(scene.time_step),
            float(np.abs(spectrum.rates).max()),
        )

    pairs = [("sph", "explicit_euler"), *(("lifted_full", name) for name in lifted.INTEGRATORS)]
    return _arrays([contender(*pair).measure(scene) for pair in pairs])


def reduced(
    scene: Scene, mode_counts: Iterable[int], modes: Arrays, energy_modes: Arrays
) -> Arrays:
    """Predicted and measured limits of reduced models: original, frozen10 and the lifted ones.

    Parameters
    ----------
    mode_counts : ints
        Modes for each field, or all there are.
    modes : dict
        velocity_modes, density_modes (one a row).
    energy_modes : dict
        As from `lifted_rom.decompose`.

    Returns
    -------
    dict
        As that of `full`. A model that carries no wave has no row.
    """
    results, dt = [], scene.time_step
    for count in mode_counts:
        for name in MODELS:
            model = rom.galerkin(scene, name, modes, count)
            march, operator = march_galerkin(model), model.operator()
            for contender in _reduced(name, count, march, operator, dt, blur(model)):
                seed, kv = contender.seed(dt), len(model.velocity_modes)
                velocity = seed[:kv] @ model.velocity_modes
                strain = seed[kv:] @ model.density_modes / scene.density0()
                small = _constant(_small(scene, seed, velocity, strain))
                results.append(replace(contender, seed=small).measure(scene))
        lifted_model = lifted_rom.build(scene, energy_modes, count)
        for name in lifted_rom.METHODS:
            march, operator = march_lifted(lifted_model, name), lifted_model.operator
            results += [c.measure(scene) for c in _reduced(name, count, march, operator, dt)]
    return _arrays(results)


def blur(model: rom.ReducedModel) -> float:
    """How well the eigenvalues of a nonlinear reduced model are known [1/s].

    The initial density projected on modes is no exact equilibrium. Around it the model's state, and
    with it the coefficients of its linear form, move by what the projection leaves, of the rate at
    which waves strain the velocity modes. An eigenvalue smaller than that, such as that of a
    uniform change of density, is as good as zero.
    """
    scene, density0 = model.scene, model.scene.density0()
    projected = model.density_modes.T @ (model.density_modes @ density0)
    speed = np.sqrt(scene.modulus() / density0).max()
    straining = speed * np.linalg.norm(scene.derivative(model.velocity_modes), 2)
    return float(np.abs(projected / density0 - 1).max() * straining)


def _reduced(name, count, march, operator, time_step, blur=0.0):
    """Contenders whose most restrictive mode is an eigenvector of an operator; none without one."""
    rates, vectors = np.linalg.eig(operator)
    limits, still = euler_limits(rates, blur), neutral(rates, blur)
    growth_rates = np.where(still, -np.inf, euler_growth_rates(rates, time_step))
    critical = int(np.argmax(growth_rates) if limits.min() == 0 else np.argmin(limits))
    exact = name == "lifted_exact"
    if still.all() and not exact:
        return
    yield Contender(
        name,
        "exact" if exact else "explicit_euler",
        count,
        march,
        DRIFTING_STEPS if name in MODELS else STEPS,
        _constant(vectors[:, critical]),
        np.inf if exact else float(limits.min()),
        float(growth_rates.max()),
        float(np.abs(rates).max()),
    )


def _constant(seed):
    return lambda _: seed


def _arrays(results):
    return {name: np.array([row[name] for row in results]) for name in results[0]}


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """Each limit or growth rate of `full` or `reduced` as a row of a table."""
    for n, contender in enumerate(arrays["contender"]):
        grows = not np.isnan(arrays["predicted_growth_rate"][n])
        name = "growth_rate" if grows else "time_step"
        predicted, measured = (
            float(arrays[f"{kind}_{name}"][n]) for kind in ("predicted", "measured")
        )
        yield {
            **place,
            "model": str(contender),
            "modes": int(arrays["contender_mode_count"][n]),
            "integrator": str(arrays["integrator"][n]),
            "quantity": "growth_rate [1/s]" if grows else "time_step [s]",
            "predicted_limit": predicted,
            "measured_limit": measured,
            "relative_difference": 0.0 if predicted == measured else measured / predicted - 1,
        }


STUDY = Study(
    datasets={
        "time_steps": Dataset(
            compute="studies.time_steps.full",
            message="{scene}: largest stable time steps of full models",
            places=scenes,
        ),
        "reduced_time_steps": Dataset(
            compute="studies.time_steps.reduced",
            message="{scene}: largest stable time steps of reduced models, snapshots {sampling}",
            of_sampling=True,
            reads={"modes": "pod.nc", "energy_modes": "lifted_pod.nc"},
            arguments={"mode_counts": "mode_counts"},
            needs=WITHOUT_FREE_ENDS,
            places=partial(samplings, first=True),
        ),
    },
    tables={"time_steps": ("studies.time_steps.rows", "time_steps", "reduced_time_steps")},
    drawing=Drawing(
        draw="figures.stability_plots.time_steps",
        caption="Stable time steps by the spectrum, beside those from which runs grow.",
        reads={"tables": ("time_steps", "reduced_time_steps")},
    ),
    variables=meanings(
        """
        predicted_time_step (contender_index) [s]: largest stable time step by the spectrum; NaN
            where there is none
        measured_time_step (contender_index) [s]: time step from which runs grow; NaN where all of
            them do
        predicted_growth_rate (contender_index) [s-1]: growth rate of the fastest wave by the
            spectrum, NaN if stable
        measured_growth_rate (contender_index) [s-1]: growth rate of the fastest wave in a run, NaN
            if stable
        """
    ),
)
