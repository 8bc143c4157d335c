"""Where runs grow and where they do not, over damping, mode count and time step.

All waves are seeded at random, so that a map shows what a run does that knows nothing of spectra;
the boundary that `sphpod.stability.spectrum` predicts is drawn beside it.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from sphpod.numerics.error import Arrays
from sphpod.numerics.expressions import Expression
from sphpod.pipeline.dataset import meanings
from sphpod.reduced import lifted_rom
from sphpod.reduced.rom import galerkin
from sphpod.scene.scene import Scene
from sphpod.scene.waves import fastest_wave
from sphpod.stability.spectrum import euler_limits, frequencies, splitting_limit, wave_rates
from sphpod.studies.study import STEADY, Dataset, Drawing, Study
from sphpod.studies.time_steps import (
    SEED,
    blur,
    late_growth,
    march_full,
    march_galerkin,
    march_lifted,
)

MAPPED = ("explicit_euler", "leapfrog")
"""Integrators of the map over damping."""

NO_WAVE = 1e-9
"""Frequency below which a motion is no wave, of the scene's fastest."""

MAP_RUN, REDUCED_MAP_RUN = (10, 400), (1, 2000)
"""Steps from output to output, and outputs, of the runs of a map."""


def of_damping(scene: Scene, size: int = 25) -> Arrays:
    """Growth of the lifted full model over damping and time step, beside the predicted limit.

    The scene's damping is replaced by uniform ones about the frequency ω of its fastest wave, up to
    which damping helps explicit Euler and beyond which it hinders. All waves are seeded at random.

    Parameters
    ----------
    size : int
        Dampings and time steps.

    Returns
    -------
    dict
        Arrays map_…, as `STUDY` describes them.
    """
    frequency = frequencies(scene)
    fastest = frequency[0]
    dampings = fastest * np.geomspace(1 / 50, 5, size)
    time_steps = np.geomspace(0.01, 20, size) / fastest
    growths = np.empty((len(MAPPED), size, size))
    limits = np.empty((len(MAPPED), size))
    state = np.random.default_rng(0).standard_normal(2 * scene.particle_count)
    for m, damping in enumerate(dampings):
        case = replace(scene, damping=Expression(repr(float(damping)), ("x",), {}))
        limits[:, m] = (
            euler_limits(wave_rates(frequency, damping)).min(),
            splitting_limit(fastest, damping),
        )
        for n, integrator in enumerate(MAPPED):
            march = march_full(case, integrator)
            for t, time_step in enumerate(time_steps):
                growths[n, m, t] = late_growth(march(state, time_step, *MAP_RUN), MAP_RUN[0])
    return {
        "map_integrator": np.array(MAPPED),
        "map_damping": dampings,
        "map_time_step": time_steps,
        "map_growth": growths,
        "map_limit": limits,
    }


def of_modes(
    scene: Scene, mode_counts: Iterable[int], modes: Arrays, energy_modes: Arrays, size: int = 25
) -> Arrays:
    """Growth of reduced models over mode count and time step, beside the predicted limit.

    Without damping there is no limit (NaN): every step grows, by what the map shows.

    Parameters
    ----------
    scene, mode_counts, modes, energy_modes
        As in `time_steps.reduced`.
    size : int
        Time steps.

    Returns
    -------
    dict
        contender (original, lifted_euler), mode_count, map_time_step, mode_growth and mode_limit,
        as `STUDY` describes them.
    """
    counts, rng = list(mode_counts), np.random.default_rng(0)
    limits, fastest = np.empty((2, len(counts))), np.empty(len(counts))
    runs = {}
    # Coordinates of small strains.
    small = SEED * np.linalg.norm(scene.density0()) / np.sqrt(scene.particle_count)
    for n, count in enumerate(counts):
        original = galerkin(scene, "original", modes, count)
        model = lifted_rom.build(scene, energy_modes, count)
        models = (
            (original.operator(), march_galerkin(original), small, blur(original)),
            (model.operator, march_lifted(model, "lifted_euler"), 1.0, 0.0),
        )
        for m, (operator, march, size_of_seed, known) in enumerate(models):
            rates = np.linalg.eigvals(operator)
            limits[m, n] = euler_limits(rates, known).min() or np.nan
            fastest[n] = np.abs(rates).max()
            runs[m, n] = march, size_of_seed * rng.standard_normal(len(operator))
    finite = limits[np.isfinite(limits)]
    if finite.size:
        span = finite.min() / 3, finite.max() * 3
    else:
        # A translation is no wave, and may be all that a model holds.
        of_scene = fastest_wave(scene)
        waves = fastest[fastest > NO_WAVE * of_scene]
        waves = waves if waves.size else np.array([of_scene])
        span = 0.01 / waves.max(), 3 / waves.min()
    time_steps = np.geomspace(*span, size)
    growths = np.empty((2, len(counts), size))
    for at, (march, state) in runs.items():
        for t, time_step in enumerate(time_steps):
            growths[(*at, t)] = late_growth(march(state, time_step, *REDUCED_MAP_RUN), 1)
    return {
        "contender": np.array(["original", "lifted_euler"]),
        "mode_count": np.array(counts),
        "map_time_step": time_steps,
        "mode_growth": growths,
        "mode_limit": limits,
    }


STUDY = Study(
    datasets={
        "damping_map": Dataset(
            compute="studies.stability_map.of_damping",
            message="{scene}: stability against damping and time step",
            needs=STEADY,
        ),
        "mode_map": Dataset(
            compute="studies.stability_map.of_modes",
            message="{scene}: stability against modes and time step, snapshots {sampling}",
            of_sampling=True,
            reads={"modes": "pod.nc", "energy_modes": "lifted_pod.nc"},
            arguments={"mode_counts": "all_mode_counts"},
            needs=STEADY,
        ),
    },
    drawing=Drawing(
        draw="figures.stability_plots.stability_map",
        caption="Growth of full and reduced models, measured, and the predicted boundary: "
        "{scene}, snapshots {sampling}.",
        reads={"damping": ("damping_map",), "modes": ("mode_map",)},
        places=lambda config: config["stability"]["stability_map"].items(),
    ),
    variables=meanings(
        """
        map_integrator (map_integrator_index): integrator of a stability map
        map_damping (map_damping) [s-1]: damping coefficient of a stability map
        map_time_step (map_time_step) [s]: time step of a stability map
        map_growth (map_integrator_index, map_damping, map_time_step) [1]: logarithm of the growth
            of the amplitude in a step, measured in the full model
        map_limit (map_integrator_index, map_damping) [s]: largest stable time step by the spectrum
        mode_growth (contender_index, mode_count, map_time_step) [1]: logarithm of the growth of the
            amplitude in a step, measured in a reduced model
        mode_limit (contender_index, mode_count) [s]: largest stable time step of a reduced model
        """
    ),
)
