"""How energy grows or stays: predicted from the waves that the particles carry, and measured.

The scaled velocity u and strain p of `sphpod.full.lifted` obey u' = A p, p' = -Aᵀ u where nothing
damps or pushes. In the singular value decomposition A = P diag(ω) Qᵀ, every wave z = Pᵀ u + i Qᵀ p
goes by itself, z' = -i ω z, with energy |z|²/2.

Explicit Euler multiplies a wave by 1 - i ω Δt, its energy by 1 + ω² Δt², so after n steps

    E(n) = Σ_j E_j (1 + ω_j² Δt²)^n.

What other integrators keep in place of the energy is in `sphpod.full.energy`.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sphpod.full import energy, lifted, sph
from sphpod.numerics.error import Arrays, blocks, share
from sphpod.pipeline.dataset import meanings
from sphpod.reduced.lifted_rom import LiftedModel
from sphpod.scene.scene import Scene
from sphpod.studies.study import UNDAMPED, Dataset, Drawing, Study, scenes

CONSERVING = ("symplectic_euler", "leapfrog", "exact")

OUTPUTS = 1000
"""Times at which a run is looked at, after its start."""

PART_OF_LIMIT = 0.5
"""Part of the stable limit 2/ω of the fastest wave that energies are followed with."""


@dataclass(frozen=True)
class Waves:
    """The waves of a scene that nothing damps or pushes, and what explicit Euler makes of them.

    Rounding is a source of waves of its own: a density is rounded in every step, by errors that are
    uniform within half its spacing in floating point and independent of one another. They add an
    expected q_j to the |z|² of each wave, and what step m adds grows for n - m steps, so that

        Σ_(m ≤ n) q_j (1 + ω_j² Δt²)^(n-m) = q_j ((1 + ω_j² Δt²)^n - 1)/(ω_j² Δt²).

    Velocities are far below the speed of sound, and rounded that much finer.

    Attributes
    ----------
    frequencies : array, shape (N,)
        ω_j [1/s], falling.
    start : complex array, shape (N,)
        z_j of the initial velocity [root of J/m²].
    strains : array, shape (N, N)
        Strain of each wave of unit length, one a row.
    """

    scene: Scene
    frequencies: np.ndarray
    start: np.ndarray
    strains: np.ndarray

    @classmethod
    def of(cls, scene: Scene) -> "Waves":
        mass, stiffness = lifted.energy_weights(scene)
        every = np.eye(scene.particle_count)
        left, frequencies, right = np.linalg.svd(lifted.pull(scene, every).T)
        start = (left.T @ (mass * scene.velocity0())).astype(complex)
        return cls(scene, frequencies, start, right / stiffness)

    @property
    def gain(self) -> np.ndarray:
        """Logarithm of 1 + ω² Δt², by which a step multiplies the energy of each wave, (N,)."""
        return np.log1p((self.frequencies * self.scene.time_step) ** 2)

    def rounding(self, steps: np.ndarray) -> np.ndarray:
        """Expected |z|² of what rounding has put into each wave after steps (…, 1), (…, N)."""
        density0 = self.scene.density0()
        _, stiffness = lifted.energy_weights(self.scene)
        above, below = np.spacing(density0), np.spacing(np.nextafter(density0, 0))
        # Densities swing to both sides of the initial one, where floating point may space unlike.
        variance = (above**2 + below**2) / 24 / density0**2
        added = (self.strains * stiffness**2) ** 2 @ variance
        grown, rate = np.expm1(self.gain * steps), np.expm1(self.gain)
        return added * np.where(rate > 0, grown / np.where(rate > 0, rate, 1), steps)

    def energy(self, step: int) -> float:
        """Expected energy after so many steps [J/m²]."""
        grown = np.abs(self.start) ** 2 * np.exp(self.gain * step)
        return float(grown.sum() + self.rounding(np.array(step)).sum()) / 2

    def smallest_jacobian(self, steps: np.ndarray) -> np.ndarray:
        """Smallest 1 + e of all particles after each of so many steps, shape (times,).

        Of N normal deviates, the largest is about √(2 ln N) times their standard deviation: so far
        rounding is taken to lower the strain that the start alone would give.
        """
        angle = np.arctan(self.frequencies * self.scene.time_step)
        smallest = np.empty(steps.size)
        reach = np.sqrt(2 * np.log(self.scene.particle_count))
        for rows in blocks(steps.size):
            step = steps[rows, None]
            strain = (self.start * np.exp((self.gain / 2 - 1j * angle) * step)).imag @ self.strains
            # Rounding gives half of its energy to the strain.
            deviation = np.sqrt(self.rounding(step) / 2 @ self.strains**2)
            smallest[rows] = (1 + strain - reach * deviation).min(axis=1)
        return smallest


def measure(
    scene: Scene, horizons: Sequence[float], energy_horizon: float
) -> dict[str, np.ndarray]:
    """Growth under explicit Euler, and what other integrators keep.

    Parameters
    ----------
    scene : Scene
        Without damping and force.
    horizons : floats
        Times [s] over which full SPH runs with the scene's own time step.
    energy_horizon : float
        Time [s] over which conserved energies are followed.

    Returns
    -------
    dict
        As `STUDY` describes it; a breakdown is looked for at `OUTPUTS` times. Full SPH steps the
        density, which compression alone cannot make negative as it can the linear strain, so it
        breaks down a few e-folds of the fastest wave apart from what is predicted.

    Raises
    ------
    ValueError
        The scene is damped or forced.
    """
    if not scene.is_conservative:
        raise ValueError(f"scene {scene.name}: its energy is not its own: it is damped or forced")
    waves = Waves.of(scene)
    grown = np.array([_growth(waves, horizon) for horizon in horizons]).T
    limit = PART_OF_LIMIT * 2 / waves.frequencies[0]
    kept = np.array([drift(scene, name, energy_horizon, limit) for name in CONSERVING]).T
    return {
        "horizon": np.array(horizons, float),
        "predicted_energy_growth": grown[0],
        "measured_energy_growth": grown[1],
        "predicted_breakdown_time": grown[2],
        "measured_breakdown_time": grown[3],
        "conserving": np.array(CONSERVING),
        "energy_time_step": kept[0],
        "energy_drift": kept[1],
        "energy_horizon": np.array(energy_horizon, float),
    }


def _growth(waves, horizon):
    """Energy growth and breakdown time over a horizon, predicted and measured of each."""
    scene = waves.scene
    count = round(horizon / scene.time_step)
    steps = np.unique(np.linspace(0, count, OUTPUTS + 1).round().astype(int))
    broken = np.flatnonzero(~(waves.smallest_jacobian(steps) > 0))
    predicted_time = scene.times(steps)[broken[0]] if broken.size else np.nan
    run = sph.prepare(scene, steps).run()
    measured, measured_time = np.nan, np.nan
    if (breakdown := run.breakdown()) is not None:
        measured_time = breakdown.time
    else:
        velocity, density = (field[[0, -1]] for field in run.state)
        measured = _grown(*energy.total(scene, velocity, lifted.strain(scene, density)))
    return _grown(waves.energy(0), waves.energy(count)), measured, predicted_time, measured_time


def _grown(start, end):
    """Factor of growth of an energy; 1 where nothing moves."""
    return end / start if start > 0 else 1.0


def drift(
    scene: Scene, integrator: str, horizon: float, largest_step: float
) -> tuple[float, float]:
    """Time step of an integrator (NaN if exact), and how far what it keeps drifts over a horizon.

    Parameters
    ----------
    scene : Scene
        Without damping and force.
    integrator : {"symplectic_euler", "leapfrog", "exact"}
        Exact steps are those of normal modes, as many as there are particles.
    horizon : float
        Time [s].
    largest_step : float
        Bound of the time step [s], of which outputs are whole multiples.

    Returns
    -------
    time_step, drift : float
        Step [s], and the largest relative change of the kept energy at `OUTPUTS` times.
    """
    interval = horizon / OUTPUTS
    long = replace(scene, duration=horizon, error_interval=interval, time_step=interval)
    if integrator == "exact":
        step = np.nan
        mass, stiffness = lifted.energy_weights(scene)
        every = np.eye(scene.particle_count)
        model = LiftedModel(long, every, every, 0)
        scaled = model.prepare("lifted_exact").solve().coordinates()
        velocity, strain = scaled[0] / mass, scaled[1] / stiffness
    else:
        step = interval / np.ceil(interval / largest_step)
        found = lifted.solve(long, integrator, step)
        velocity, strain = found["velocity"], found["strain"]
    kept = energy.kept(scene, integrator, step, velocity, strain)
    return step, share(np.abs(kept - kept[0]).max(), kept[0])


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """Rows of a table: one for each horizon of explicit Euler, one for each conserved energy."""
    for n, horizon in enumerate(arrays["horizon"]):
        numbers = {
            name: float(arrays[name][n])
            for name in (
                "predicted_energy_growth", "measured_energy_growth", "predicted_breakdown_time",
                "measured_breakdown_time",
            )
        }  # fmt: skip
        yield {**place, "integrator": "explicit_euler", "horizon": float(horizon), **numbers}
    for n, integrator in enumerate(arrays["conserving"]):
        yield {
            **place,
            "integrator": str(integrator),
            "horizon": float(arrays["energy_horizon"]),
            "time_step": float(arrays["energy_time_step"][n]),
            "energy_drift": float(arrays["energy_drift"][n]),
        }


STUDY = Study(
    datasets={
        "growth": Dataset(
            compute="studies.growth.measure",
            message="{scene}: growth of the energy over long times",
            arguments={
                "horizons": lambda scene, setting: [
                    n * scene.duration for n in setting("stability.horizon_factors")
                ],
                "energy_horizon": lambda scene, setting: (
                    setting("stability.energy_horizon_factor") * scene.duration
                ),
            },
            needs=UNDAMPED,
            places=partial(scenes, needs=UNDAMPED),
        )
    },
    tables={"growth": ("studies.growth.rows", "growth")},
    drawing=Drawing(
        draw="figures.stability_plots.growth",
        caption="Growth of the energy under explicit Euler, predicted and measured; energies kept.",
        reads={"scenes": ("growth",)},
    ),
    variables=meanings(
        """
        horizon (horizon) [s]: time over which explicit Euler runs
        predicted_energy_growth (horizon) [1]: energy at the end, of that at the start, by the
            spectrum
        measured_energy_growth (horizon) [1]: energy at the end of full SPH, of that at the start;
            NaN if it broke
        predicted_breakdown_time (horizon) [s]: time at which the Jacobian reaches zero by the
            spectrum, NaN if never
        measured_breakdown_time (horizon) [s]: time at which full SPH broke down, NaN if it did not
        conserving (conserving_index): integrator that keeps an energy
        energy_time_step (conserving_index) [s]: its time step, NaN if exact
        energy_drift (conserving_index) [1]: largest relative change of the energy that it keeps
        energy_horizon () [s]: time over which the energies are followed
        """
    ),
)
