"""What becomes of every model as the initial velocity grows until the particles fold.

The initial velocity is scaled until the Jacobian J = ρ0/ρ of full SPH reaches zero, which is at
about the inverse of the strain of the scene's own amplitude.

In ρ the equations are nonlinear. Linearized and frozen models take ρ/ρ0 - 1 = -e + e² - … for
1 - ρ0/ρ = -e, so that their waves are wrong by O(e); the original model's equations are exact, but
snapshots of ρ = ρ0/(1 + e) hold the products of all waves in e and need ever more modes.

In e they are linear, and what remains is the time step. Explicit Euler in ρ differs from that in e
by O(Δt e²) a second, so that full SPH and ``lifted_euler`` part by O(Δt e) of the solution. Both
let the energy of a wave of angular frequency ω grow by exp(ω² Δt t), the faster the wave the more,
which makes an undamped scene fold at a smaller amplitude; and in ρ, which tends to infinity there,
explicit Euler lags behind the fold, which makes it fold at a larger one. The folding amplitude of
the model that is exact in time shows how much both come to.

``lifted_exact`` is therefore held against the lifted full model exact in time, and all others
against full SPH. Both of that pair are linear: the relative error of the velocity changes with the
amplitude only as far as the snapshots, those of full SPH, do.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics.error import FIELDS, Arrays, project
from sphpod.pipeline.dataset import meanings
from sphpod.reduced import lifted_rom, pod
from sphpod.reduced.rom import galerkin
from sphpod.reduced.snapshots import output_steps, sampling_steps
from sphpod.reduced.sweep import ReducedRun
from sphpod.scene.scene import Scene
from sphpod.studies.study import STEADY, Dataset, Drawing, Study

FULL = ("sph", "lifted_full")
REDUCED = ("original", "linearized", "frozen10", *lifted_rom.METHODS)
CONTENDERS = (*FULL, *REDUCED)

NEAR, BEYOND = 0.99, 1.25
"""The last two amplitudes, of the folding one: full SPH lasts under the first of them alone."""

PRECISION = 1e-4
"""Relative precision of the folding amplitude: nearer to it, chance decides whether a step of
explicit Euler, with a density that tends to infinity, misses that J = 0."""

LARGEST = 2.0**40
"""Amplitude up to which folding is looked for."""


class Solution(NamedTuple):
    """A full solution: velocity and density (times, N), and when it broke down [s], else NaN."""

    fields: dict[str, np.ndarray]
    breakdown_time: float


class Superposition(NamedTuple):
    """The lifted full model, exact in time and linear: x(factor) = x(0) + factor (x(1) - x(0)).

    `rest` is x(0), that is what the force does, and `response` x(1) - x(0): velocity and strain.
    """

    scene: Scene
    rest: dict[str, np.ndarray]
    response: dict[str, np.ndarray]

    @classmethod
    def of(cls, scene: Scene) -> "Superposition":
        rest, own = (lifted.solve(scaled(scene, factor), "exact") for factor in (0, 1))
        return cls(scene, rest, {name: own[name] - rest[name] for name in ("velocity", "strain")})

    def solution(self, factor: float) -> Solution:
        """The solution for a factor of the initial velocity; its fields only if it lasts."""
        velocity, strain = (
            self.rest[name] + factor * change for name, change in self.response.items()
        )
        folded = (strain <= -1).any(axis=1)
        if folded.any():
            return Solution({}, self.scene.error_times[folded.argmax()])
        return Solution(
            {"velocity": velocity, "density": lifted.density(self.scene, strain)}, np.nan
        )

    def folding_amplitude(self) -> float:
        """The smallest factor with which a strain reaches -1."""
        strain, falling = self.rest["strain"], self.response["strain"] < 0
        return float(((1 + strain[falling]) / -self.response["strain"][falling]).min())


def study(
    scene: Scene, sampling: Mapping[str, Any], mode_count: int, count: int
) -> dict[str, np.ndarray]:
    """Errors and breakdowns of full and reduced models, from the scene's amplitude to beyond J = 0.

    Reduced models have the snapshots of full SPH of their own amplitude, those before it broke.

    Parameters
    ----------
    sampling : dict
        As `snapshots.sampling_steps` takes it.
    mode_count : int
        k of the reduced models.
    count : int
        Amplitudes: all but one are evenly spaced in their logarithm up to `NEAR` of the folding
        amplitude, the last is `BEYOND` it.

    Returns
    -------
    dict
        contender (contenders,), and what `STUDY` describes. Errors are NaN of full models and where
        the full model that is the reference broke down, infinite where the reduced model did.

    Raises
    ------
    Breakdown
        Full SPH breaks down at the scene's own amplitude.
    ValueError
        No amplitude makes it break down.
    """
    steps = output_steps(scene, [sampling])
    folding = folding_amplitude(scene, steps)
    factors = np.append(np.geomspace(1, NEAR * folding, count - 1), BEYOND * folding)
    shape = len(CONTENDERS), count
    errors = {field: np.full(shape, np.nan) for field in FIELDS}
    times, jacobians = np.full(shape, np.nan), np.empty(count)
    lifted_waves = Superposition.of(scene)
    for n, factor in enumerate(factors):
        case = scaled(scene, factor)
        full, taken, jacobians[n] = _run_sph(case, steps, sampling)
        lifted_full = lifted_waves.solution(factor)
        times[: len(FULL), n] = full.breakdown_time, lifted_full.breakdown_time
        modes = pod.decompose(taken) | lifted_rom.decompose(case, taken)
        for row, name in enumerate(REDUCED, len(FULL)):
            reference = lifted_full if name == "lifted_exact" else full
            found, times[row, n] = _reduce(case, name, modes, mode_count, reference)
            for field in FIELDS:
                errors[field][row, n] = found[field]
    return {
        "amplitude": factors,
        "smallest_jacobian": jacobians,
        "folding_amplitude": np.array(folding),
        "lifted_folding_amplitude": np.array(lifted_waves.folding_amplitude()),
        "contender": np.array(CONTENDERS),
        "scaled_velocity_error": errors["velocity"],
        "scaled_density_error": errors["density"],
        "scaled_breakdown_time": times,
    }


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """A study as a table, a row a contender and amplitude."""
    folding = float(arrays["folding_amplitude"])
    for row, name in enumerate(arrays["contender"]):
        for n, factor in enumerate(arrays["amplitude"]):
            yield {
                **place,
                "model": str(name),
                "amplitude": float(factor),
                "of_folding_amplitude": float(factor) / folding,
                "smallest_jacobian": float(arrays["smallest_jacobian"][n]),
                "velocity_error": float(arrays["scaled_velocity_error"][row, n]),
                "density_error": float(arrays["scaled_density_error"][row, n]),
                "breakdown_time": float(arrays["scaled_breakdown_time"][row, n]),
            }


def scaled(scene: Scene, factor: float) -> Scene:
    """The scene with its initial velocity times a factor."""
    given = scene.initial_velocity
    return replace(scene, initial_velocity=given.rewritten(f"{float(factor)!r}*({given.text})"))


def folding_amplitude(scene: Scene, steps: np.ndarray) -> float:
    """Factor of the initial velocity from which full SPH breaks down, by bisection of real runs.

    Parameters
    ----------
    steps : int array
        Steps after which the Jacobian is looked at.

    Raises
    ------
    Breakdown
        Full SPH breaks down at the scene's own amplitude.
    ValueError
        No amplitude up to `LARGEST` makes it break down.
    """
    sph.prepare(scene, steps).solve()

    def folds(factor):
        return sph.prepare(scaled(scene, factor), steps).run().breakdown() is not None

    low, high = 1.0, 2.0
    while not folds(high):
        if high >= LARGEST:
            raise ValueError(
                f"scene {scene.name}: initial_velocity = {scene.initial_velocity.text}: "
                f"{LARGEST:.0e} times as much does not fold the particles, which takes a velocity "
                "that strains them"
            )
        low, high = high, 2 * high
    while high > (1 + PRECISION) * low:
        middle = (low + high) / 2
        low, high = (low, middle) if folds(middle) else (middle, high)
    return high


def _run_sph(scene, steps, sampling):
    """Full SPH at the times of the error integral, its snapshots, and its smallest Jacobian."""
    run = sph.prepare(scene, steps).run()
    whole = steps.size if run.failed < 0 else run.failed // scene.particle_count
    kept = run.fields(slice(whole))
    taken = {"x": scene.positions}
    for field, chosen in zip(FIELDS, sampling_steps(scene, sampling), strict=True):
        at = np.searchsorted(steps, chosen)
        taken[f"{field}_snapshots"] = kept[field][at[at < whole]]
    with np.errstate(all="ignore"):
        jacobian = np.nanmin(scene.density0() / run.fields(slice(whole + 1))["density"])
    at = np.searchsorted(steps, scene.error_steps)
    own = {field: values[at[at < whole]] for field, values in kept.items()}
    time = np.nan if run.failed < 0 else run.times[whole]
    return Solution(own, time), taken, jacobian


def _reduce(scene, name, modes, count, reference):
    """Errors of a reduced model against a full solution, and when it broke down."""
    errors = dict.fromkeys(FIELDS, np.nan if np.isfinite(reference.breakdown_time) else np.inf)
    run: ReducedRun
    if name in lifted_rom.METHODS:
        run = lifted_rom.build(scene, modes, count).prepare(name)
    else:
        run = galerkin(scene, name, modes, count).prepare(scene.error_steps)
    broken = run.run().breakdown()
    if broken is not None:
        return errors, broken.time
    if np.isfinite(reference.breakdown_time):
        return errors, np.nan
    if name in lifted_rom.METHODS:
        return lifted_rom.field_errors(run, reference.fields), np.nan
    for field, (coordinates, shapes) in run.expansions().items():
        errors[field] = project(reference.fields[field], shapes).relative_error(coordinates)
    return errors, np.nan


STUDY = Study(
    datasets={
        "amplitude": Dataset(
            compute="studies.amplitude.study",
            message="{scene}: all models until the line folds, snapshots {sampling}",
            of_sampling=True,
            arguments={
                "sampling": "sampling",
                "mode_count": "largest_mode_count",
                "count": "stability.amplitude_count",
            },
            needs=STEADY,
            places=lambda config: config["stability"]["amplitude"].items(),
        )
    },
    tables={"amplitude": ("studies.amplitude.rows", "amplitude")},
    drawing=Drawing(
        draw="figures.stability_plots.amplitude",
        caption="Errors of reduced models until the line folds: {scene}, snapshots {sampling}.",
        reads={"amplitude": ("amplitude",)},
        places=lambda config: config["stability"]["amplitude"].items(),
    ),
    variables=meanings(
        """
        amplitude (amplitude) [1]: factor of the scene's initial velocity
        smallest_jacobian (amplitude) [1]: smallest Jacobian of full SPH over time and particles
        folding_amplitude () [1]: amplitude from which full SPH breaks down
        lifted_folding_amplitude () [1]: amplitude from which the lifted full model, exact in time,
            breaks down
        scaled_velocity_error (contender_index, amplitude) [1]: relative L2 error of the velocity,
            against its full model
        scaled_density_error (contender_index, amplitude) [1]: relative L2 error of the density,
            against its full model
        scaled_breakdown_time (contender_index, amplitude) [s]: time at which the model broke down,
            NaN if it did not
        """
    ),
)
