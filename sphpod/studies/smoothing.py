"""Smoothing length: what α = h/Δx does to the derivative, the stable step, and the error.

The SPH derivative of a smooth function is β f' + κ f''' Δx² + …, with β and κ of α alone. So a wave
of wavenumber q travels at β - κ (q Δx)² times its speed, and a β other than 1 is an error that more
particles do not lessen. κ is positive; β is above 1 for 1 < α < √6 - 1, where both errors are of
opposite sign: those waves travel right for which β - 1 = κ (q Δx)². The best α therefore depends on
how finely a scene is resolved, and nears one with β = 1 as particles grow many.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics.error import FIELDS, Arrays, relative_error
from sphpod.pipeline.dataset import meanings
from sphpod.scene.kernel import derivative_coefficient, dispersion_coefficient, neighbour_count
from sphpod.scene.scene import Scene
from sphpod.studies.study import Dataset, Drawing, Study, scenes

THINNING = 10
"""Only each of so many samples of the error integral is taken, which changes errors by far less
than 1 %."""


def study(
    scene: Scene, smoothing_ratios: Iterable[float], reference: Arrays
) -> dict[str, np.ndarray]:
    """Full SPH of a scene with one smoothing length after another.

    Parameters
    ----------
    scene : Scene
        Whose own smoothing ratio is put aside.
    smoothing_ratios : floats
        α.
    reference : dict
        velocity and density (times, N) of the exact solution.

    Returns
    -------
    dict
        As `STUDY` describes it; errors are NaN where the run broke down.
    """
    ratios = list(smoothing_ratios)
    others = [replace(scene, smoothing_ratio=ratio) for ratio in ratios]
    errors = np.array([_errors(other, reference) for other in others])
    return {
        "smoothing_ratio": np.array(ratios, float),
        "scene_smoothing_ratio": np.array(scene.smoothing_ratio),
        "derivative_coefficient": np.array([derivative_coefficient(ratio) for ratio in ratios]),
        "dispersion_coefficient": np.array([dispersion_coefficient(ratio) for ratio in ratios]),
        "neighbour_count": np.array([neighbour_count(ratio) for ratio in ratios]),
        "stable_time_step": np.array([2 / fastest_frequency(other) for other in others]),
    } | {f"smoothing_{field}_error": errors[:, n] for n, field in enumerate(FIELDS)}


def _errors(scene, reference):
    steps = scene.error_steps[::THINNING]
    run = sph.prepare(scene, steps).run()
    if run.breakdown() is not None:
        return np.nan, np.nan
    return tuple(
        relative_error(found, reference[name][::THINNING]) for name, found in run.fields().items()
    )


def fastest_frequency(scene: Scene) -> float:
    """Angular frequency of the fastest wave without damping [1/s], the 2-norm of A."""
    if lifted.is_uniform(scene):
        # A is circulant: its singular values are the sizes of the spectrum of one column.
        column = lifted.pull(scene, np.eye(1, scene.particle_count))[0]
        return float(np.abs(np.fft.fft(column)).max())
    return float(np.linalg.norm(lifted.pull(scene, np.eye(scene.particle_count)), 2))


def ranks(errors: np.ndarray) -> np.ndarray:
    """Rank of each error (n,), 1 for the smallest; those that are NaN rank last, alike."""
    errors = np.where(np.isnan(errors), np.inf, errors)
    return 1 + np.count_nonzero(errors < errors[:, None], axis=1)


def overall(studies: Iterable[Arrays]) -> dict[str, np.ndarray]:
    """Geometric means of the errors of several scenes, studied with the same ratios.

    No scene counts more than another, however large its errors are; a ratio with which one of them
    broke down has no mean.

    Returns
    -------
    dict
        As from `study`, without stable_time_step, which is a scene's own.
    """
    every = list(studies)
    names = (
        "smoothing_ratio", "derivative_coefficient", "dispersion_coefficient", "neighbour_count",
    )  # fmt: skip
    errors = (f"smoothing_{field}_error" for field in FIELDS)
    return {name: every[0][name] for name in names} | {
        name: np.exp(np.mean([np.log(one[name]) for one in every], axis=0)) for name in errors
    }


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """Rows of a table, one for each ratio, with its rank by either error among all ratios."""
    table = {name: values for name, values in arrays.items() if np.ndim(values)} | {
        f"{field}_rank": ranks(arrays[f"smoothing_{field}_error"]) for field in FIELDS
    }
    for n in range(arrays["smoothing_ratio"].size):
        yield {**place, **{name: values[n].item() for name, values in table.items()}}


def ranking(studies: Iterable[Arrays]) -> list[dict[str, Any]]:
    """The rows of `overall`, the ratio with the smallest velocity error first.

    Parameters
    ----------
    studies : dicts
        One from `study` for each scene, with the same ratios.
    """
    table = rows({"scene": "all"}, overall(studies))
    return sorted(table, key=lambda row: row["velocity_rank"])


STUDY = Study(
    datasets={
        "smoothing": Dataset(
            compute="studies.smoothing.study",
            message="{scene}: smoothing lengths compared",
            reads={"reference": "truth"},
            arguments={"smoothing_ratios": "stability.smoothing_ratios"},
            places=scenes,
        )
    },
    tables={
        "smoothing": ("studies.smoothing.rows", "smoothing"),
        "smoothing_ranking": ("studies.smoothing.ranking", "smoothing"),
    },
    drawing=Drawing(
        draw="figures.stability_plots.smoothing",
        caption="What the smoothing length changes: consistency, stability and errors.",
        reads={"scenes": ("smoothing",)},
    ),
    variables=meanings(
        """
        smoothing_ratio (smoothing_ratio) [1]: smoothing length in spacings
        scene_smoothing_ratio () [1]: smoothing length of the scene, in spacings
        derivative_coefficient (smoothing_ratio) [1]: coefficient of the first derivative in that of
            SPH
        dispersion_coefficient (smoothing_ratio) [1]: coefficient of the third derivative in that of
            SPH
        neighbour_count (smoothing_ratio) [1] int32: neighbours on each side of a particle
        stable_time_step (smoothing_ratio) [s]: largest stable time step of leapfrog, undamped
        smoothing_velocity_error (smoothing_ratio) [1]: relative L2 error of the velocity of full
            SPH
        smoothing_density_error (smoothing_ratio) [1]: relative L2 error of the mass density of full
            SPH
        """
    ),
)
