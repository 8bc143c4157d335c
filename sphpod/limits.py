"""The time steps from which runs really grow, beside those that `sphpod.spectrum` predicts.

The most restrictive mode is seeded: the eigenvector of its eigenvalue, in both phases. Any sum of
squares over both changes by |μ|² a step, without oscillation, so that few steps tell the growth
rate ln(E_n/E_0)/(2 n Δt) to rounding. The runs are those of the models themselves; the seed is
small, so that those with nonlinear terms do not feel them.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sphpod import lifted, lifted_rom, rom, sph
from sphpod.expressions import Expression
from sphpod.scene import Scene
from sphpod.spectrum import (
    FullSpectrum,
    crossing,
    euler_growth_rates,
    euler_limits,
    neutral,
    splitting_limit,
    wave_rates,
)

Arrays = dict[str, np.ndarray]

March = Callable[[np.ndarray, float, int, int], np.ndarray]
"""``march(state, time_step, stride, outputs)``: states after every ``stride`` steps, the first one
included, shape (outputs + 1, size)."""

SEED = 1e-7
"""Largest strain of a seed, whose square is lost in rounding."""

LINEAR = 1e-2
"""Relative change of a density within which a nonlinear model is taken for linear."""

GROWS = 1e-10
"""Logarithm of the amplitude's growth in a step that is more than the rounding of a seed."""

ACCURACY = 1e-5
"""Relative accuracy of a measured time step."""

STEPS = {"rk45": 50, "dop853": 50}
"""Steps of a run; others take 1000, which are cheaper than these."""

JUMPS = 7
"""Lengths of exact jumps that are tried, from the scene's step to a hundred times its duration."""

MODELS = ("original", "frozen10")
"""The paper's reduced models; the linearized one has the operator of the frozen ones."""


# --- Runs of the models ---------------------------------------------------------------------------


def march_full(scene: Scene, integrator: str, paper: bool = False) -> March:
    """Runs of the lifted full model in scaled fields (2N,), or of the paper's full SPH.

    The adaptive integrators are held to fixed steps, by an infinite tolerance. A force, which
    changes no growth, is left out.
    """
    scene = unforced(scene)
    scales = np.concatenate(lifted.energy_weights(scene))
    count = scene.particle_count

    def run_fixed(state, time_step, stride, outputs):
        interval = stride * time_step
        case = replace(
            scene, time_step=time_step, error_interval=interval, duration=outputs * interval
        )
        velocity, strain = np.empty((2, outputs + 1, count))
        start = state[:count], state[count:]
        if paper:
            start = start[0], lifted.density(scene, start[1])
            run = sph.prepare(case, np.arange(outputs + 1) * stride, start=start, watch=False)
            run(velocity, strain)
            strain = lifted.strain(scene, strain)
        else:
            lifted.prepare(case, integrator, start=start, watch=False)(velocity, strain)
        return np.concatenate([velocity, strain], axis=1)

    def run_pair(state, time_step, stride, outputs):
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

    def march(state, time_step, stride, outputs):
        run = run_pair if integrator in lifted.ADAPTIVE else run_fixed
        return run(state / scales, time_step, stride, outputs) * scales

    return march


def march_galerkin(model: rom.ReducedModel) -> March:
    """Runs of a nonlinear reduced model about its state at rest, in its coordinates (kv + kρ,).

    The initial density projected on modes is no exact equilibrium, so what a run without a seed
    does is subtracted. Where either leaves the linear range it is not a number.
    """
    kv = len(model.velocity_modes)
    rest = model.density_modes @ model.scene.density0()

    def states_of(start, time_step, stride, outputs):
        case = replace(model, scene=replace(unforced(model.scene), time_step=time_step))
        velocity = np.empty((outputs + 1, kv))
        density = np.empty((outputs + 1, rest.size))
        start = start[:kv], rest + start[kv:]
        case.prepare(np.arange(outputs + 1) * stride, start)(velocity, density)
        with np.errstate(over="ignore", invalid="ignore"):
            moved = np.linalg.norm(density - rest, axis=1)
        beyond = ~(moved <= LINEAR * np.linalg.norm(rest))
        velocity[np.logical_or.accumulate(beyond)] = np.nan
        return np.concatenate([velocity, density - rest], axis=1)

    def march(state, time_step, stride, outputs):
        seeded, still = (
            states_of(start, time_step, stride, outputs) for start in (state, 0 * state)
        )
        return seeded - still

    return march


def march_lifted(model: lifted_rom.LiftedModel, method: str) -> March:
    """Runs of a lifted reduced model, in the coordinates of its modes (kv + ke,)."""
    own, scene = model.own, unforced(model.scene)

    def march(state, time_step, stride, outputs):
        interval = stride * time_step
        case = replace(
            scene, time_step=time_step, error_interval=interval, duration=outputs * interval
        )
        prepared = replace(model, scene=case).prepare(method)
        states = prepared.new_state()
        states[:, 0] = own.from_modes @ state
        prepared.jumps.run(states)
        return np.concatenate(model.coordinates(states), axis=1)

    return march


def unforced(scene: Scene) -> Scene:
    """The scene without its force."""
    return replace(scene, force_time=None, force_profile=None)


# --- Growth of a run ------------------------------------------------------------------------------


def growth(march: March, seed: np.ndarray, time_step: float, steps: int) -> float:
    """Logarithm of the growth of a seed's amplitude in a step; infinite if it left all bounds.

    Parameters
    ----------
    march : callable
    seed : complex array, shape (size,)
        Both phases are run.
    time_step : float
        Δt [s].
    steps : int
    """
    ends = [
        march(phase, time_step, steps, 1)[-1] for phase in (seed.real, seed.imag) if phase.any()
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        ratio = sum(end @ end for end in ends) / np.vdot(seed, seed).real
    return float(np.log(ratio) / (2 * steps)) if np.isfinite(ratio) else np.inf


def late_growth(states: np.ndarray, stride: int) -> float:
    """Logarithm of the growth of the amplitude in a step, over the second half of a run.

    Only outputs that are finite, and whose squares floating point holds, count.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        energy = np.einsum("ts,ts->t", states, states)
    held = (energy > 1e-280) & (energy < 1e280)
    last = int(np.argmin(held)) - 1 if not held.all() else len(held) - 1
    middle = last // 2
    if last < 1:
        return np.inf
    return float(np.log(energy[last] / energy[middle]) / (2 * stride * (last - middle)))


def _small(seed, strain):
    """The seed with a largest strain of SEED, or largest velocity if it strains nothing."""
    return seed * (SEED / (np.abs(strain).max(initial=0) or np.abs(seed).max()))


def _measure(march, seed_at, predicted, steps):
    """Time step from which runs grow [s], by bisection."""

    def grows(time_step):
        return growth(march, seed_at(time_step), time_step, steps) > GROWS

    return crossing(grows, predicted, ACCURACY)


def _measure_jumps(march, size, scene):
    """Shortest exact jump that grows [s]; infinite if none does."""
    seed = np.random.default_rng(0).standard_normal(size)
    for length in np.geomspace(scene.time_step, 100 * scene.duration, JUMPS):
        if growth(march, seed, length, 1) > GROWS:
            return length
    return np.inf


# --- The study ------------------------------------------------------------------------------------


@dataclass
class _Table:
    """Rows of the study, as they come."""

    rows: list[dict[str, Any]]

    def add(self, contender, integrator, count, march, limit, rate, seed_at, scene, steps):
        """Measure what is predicted: the limit of the time step, or the rate where there is none.

        ``rate`` is that at the scene's step, used where the limit is 0.
        """
        row = dict.fromkeys(
            ("contender_time_step", "predicted_time_step", "measured_time_step",
             "predicted_growth_rate", "measured_growth_rate"), np.nan,
        )  # fmt: skip
        row |= {"contender": contender, "integrator": integrator, "contender_mode_count": count}
        if limit == np.inf:
            row["predicted_time_step"] = limit
            row["measured_time_step"] = _measure_jumps(march, seed_at(1.0).size, scene)
        elif limit > 0:
            row["predicted_time_step"] = limit
            row["measured_time_step"] = _measure(march, seed_at, limit, steps) or np.nan
        else:
            dt = row["contender_time_step"] = scene.time_step
            row["predicted_growth_rate"] = rate
            row["measured_growth_rate"] = growth(march, seed_at(dt), dt, steps) / dt
        self.rows.append(row)

    def arrays(self) -> Arrays:
        return {name: np.array([row[name] for row in self.rows]) for name in self.rows[0]}


def full(scene: Scene) -> Arrays:
    """Predicted and measured limits of the full models.

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    dict
        Arrays (contenders,): contender (sph, lifted_full), integrator, contender_mode_count (0);
        predicted_time_step and measured_time_step [s], infinite for exact jumps, NaN where every
        step grows; there, predicted_growth_rate and measured_growth_rate [1/s] at
        contender_time_step [s], else NaN.
    """
    spectrum, table = FullSpectrum(scene), _Table([])
    _, stiffness = lifted.energy_weights(scene)
    for contender, integrator in [
        ("sph", "explicit_euler"), *(("lifted_full", name) for name in lifted.INTEGRATORS)
    ]:  # fmt: skip
        block = spectrum.critical(integrator)

        def seed_at(time_step, block=block, integrator=integrator):
            seed = block.fastest_growing(integrator, time_step)
            return _small(seed, seed[scene.particle_count :] / stiffness)

        table.add(
            contender, integrator, 0, march_full(scene, integrator, contender == "sph"),
            spectrum.limit(integrator), spectrum.growth_rate(scene.time_step), seed_at, scene,
            STEPS.get(integrator, 1000),
        )  # fmt: skip
    return table.arrays()


def reduced(
    scene: Scene,
    mode_counts: Iterable[int],
    modes: Mapping[str, np.ndarray],
    energy_modes: Mapping[str, np.ndarray],
) -> Arrays:
    """Predicted and measured limits of reduced models: original, frozen10 and the lifted ones.

    Parameters
    ----------
    scene : Scene
    mode_counts : ints
        Modes for each field, or all there are.
    modes : dict
        velocity_modes, density_modes (one a row).
    energy_modes : dict
        As from `lifted_rom.decompose`.

    Returns
    -------
    dict
        As that of `full`.
    """
    table = _Table([])
    for count in mode_counts:
        for contender in MODELS:
            model = galerkin(scene, contender, modes, count)
            rates, vectors = np.linalg.eig(model.operator())
            kv = len(model.velocity_modes)
            critical = _critical(rates, scene.time_step)
            seed = vectors[:, critical]
            moved = seed[kv:] @ model.density_modes / scene.density0()
            _add_reduced(
                table, scene, contender, count, march_galerkin(model), rates, critical,
                _small(seed, moved),
            )  # fmt: skip
        lifted_model = lifted_rom.build(unforced(scene), energy_modes, count)
        rates, vectors = np.linalg.eig(lifted_model.operator)
        critical = _critical(rates, scene.time_step)
        for contender in lifted_rom.METHODS:
            _add_reduced(
                table, scene, contender, count, march_lifted(lifted_model, contender), rates,
                critical, vectors[:, critical],
            )  # fmt: skip
    return table.arrays()


def galerkin(
    scene: Scene, method: str, modes: Mapping[str, np.ndarray], count: int
) -> rom.ReducedModel:
    """Reduced model of the paper with so many modes for each field, or all there are."""
    return rom.ReducedModel(
        scene, method, modes["velocity_modes"][:count], modes["density_modes"][:count]
    )


def _critical(rates, time_step):
    """The eigenvalue that limits explicit Euler's step, or that grows fastest if all steps do."""
    limits = euler_limits(rates)
    if limits.min() > 0:
        return int(np.argmin(limits))
    return int(np.argmax(euler_growth_rates(rates, time_step)))


def _add_reduced(table, scene, contender, count, march, rates, critical, seed):
    exact = contender == "lifted_exact"
    table.add(
        contender, "exact" if exact else "explicit_euler", count, march,
        np.inf if exact else euler_limits(rates).min(),
        euler_growth_rates(rates, scene.time_step)[critical], lambda _: seed, scene, 1000,
    )  # fmt: skip


def rows(place: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Iterator[dict[str, Any]]:
    """Each limit or growth rate of `full` or `reduced` as a row of a table.

    Parameters
    ----------
    place : dict
        scene, and sampling of reduced models.
    arrays : dict
    """
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
