"""What becomes of a lifted reduced model whose snapshots are poor.

Snapshots decide how good modes are, and nothing else: whatever the modes, the model is a Galerkin
projection of the lifted full model, its energy does not grow by itself, and the bound of
`error_bound` holds. So snapshots that are too few, too early, noisy or linearly dependent make the
error larger and the bound with it, and only those that are no snapshots at all, because a value is
not finite, a density not positive or nothing moves, are refused.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics.error import FIELDS, Arrays, blocks, share
from sphpod.pipeline.dataset import meanings
from sphpod.reduced import error_bound, lifted_rom, pod
from sphpod.reduced.rom import galerkin
from sphpod.scene.scene import Scene
from sphpod.studies.study import STEADY, Dataset, Drawing, Study

EARLY = 0.01
"""Part of the duration within which snapshots that are too early lie."""

RANK = 6
"""Snapshots of which rank-deficient ones are copies and combinations."""

ROUNDING = 1e-11
"""Of the largest energy norm, by which an error may exceed its bound."""


OUTCOMES = {True: "within its bound", False: "beyond its bound"}


def study(
    scene: Scene,
    taken: Arrays,
    full: Arrays,
    noise_levels: Sequence[float],
    mode_count: int,
    seed: int,
) -> dict[str, np.ndarray]:
    """Errors and bounds of ``lifted_exact`` from snapshots of every defect and level of noise.

    Errors are the largest energy norm over time of the difference from the full model, relative to
    the largest energy norm of that model: for ``lifted_exact`` from the lifted full model, exact in
    time, and for the original model, which takes the same steps, from full SPH.

    Parameters
    ----------
    taken : dict
        velocity_snapshots (n, N) [m/s] and density_snapshots (m, N) [kg/m³] without a defect.
    full : dict
        velocity and strain (times, N) of the lifted full model, exact in time.
    noise_levels : floats
        Noise of velocity and of strain, of the root mean square of each over all snapshots; the
        same draws for all levels.
    mode_count : int
        k.
    seed : int
        Of noise and of linear combinations.

    Returns
    -------
    dict
        As `STUDY` describes it. An outcome is "within its bound", "beyond its bound" or the
        sentence that refused the snapshots or reported the breakdown. Errors and bounds are NaN of
        what was refused and infinite of what broke down; a refused rank is 0.
    """
    rng = np.random.default_rng(seed)
    sph_fields = sph.solve(scene, scene.error_steps)
    found = [
        (name, count, *judge(scene, poor, full, count))
        for name, poor, count in defects(scene, taken, sph_fields, mode_count, rng)
    ]
    names, counts, ranks, errors, bounds, outcomes = map(np.array, zip(*found, strict=True))
    noise = list(noisy(scene, taken, noise_levels, rng))
    judged = [judge(scene, snapshots, full, mode_count) for snapshots in noise]
    return {
        "noise": np.array(noise_levels, float),
        "noise_error": np.array([error for _, error, _, _ in judged]),
        "noise_bound": np.array([bound for _, _, bound, _ in judged]),
        "noise_original_error": np.array(
            [original_error(scene, snapshots, sph_fields, mode_count) for snapshots in noise]
        ),
        "defect": names,
        "defect_mode_count": counts,
        "defect_rank": ranks,
        "defect_error": errors,
        "defect_bound": bounds,
        "defect_outcome": outcomes,
    }


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """A study as a table: a row a defect, then a row a level of noise."""
    columns = ("defect", "mode_count", "rank", "error", "bound", "outcome")
    names = ("defect", *(f"defect_{column}" for column in columns[1:]))
    for values in zip(*(arrays[name].tolist() for name in names), strict=True):
        yield {**place, **dict(zip(columns, values, strict=True))}
    names = ("noise", "noise_error", "noise_bound", "noise_original_error")
    for level, error, bound, original in zip(*(arrays[n].tolist() for n in names), strict=True):
        yield {
            **place,
            "defect": "noisy",
            "noise": level,
            "error": error,
            "bound": bound,
            "outcome": OUTCOMES[error <= bound + ROUNDING],
            "original_error": original,
        }


def defects(
    scene: Scene, taken: Arrays, full: Arrays, mode_count: int, rng: np.random.Generator
) -> Iterator[tuple[str, dict[str, np.ndarray], int]]:
    """Each defect's name, snapshots with it, and the modes that are asked for.

    Parameters are those of `study`, but for

    full : dict
        velocity and density (times, N) of full SPH.
    """
    velocity, density = (taken[f"{field}_snapshots"] for field in FIELDS)
    middle = len(velocity) // 2, scene.particle_count // 2

    def snapshots(*fields):
        return {f"{name}_snapshots": field for name, field in zip(FIELDS, fields, strict=True)}

    def each(change):
        return snapshots(change(velocity), change(density))

    def spoilt(value):
        wrong = velocity.copy()
        wrong[middle] = value
        return snapshots(wrong, density)

    early = np.linspace(0, EARLY * (len(full["velocity"]) - 1), len(velocity)).astype(int)
    few = np.linspace(0, len(velocity) - 1, RANK).astype(int)
    strain = lifted.strain(scene, density)[few]
    shares = np.concatenate([np.eye(RANK), np.eye(RANK), rng.standard_normal((RANK, RANK)) / RANK])
    negative = density.copy()
    negative[middle] *= -1

    yield "none", each(lambda values: values), mode_count
    yield "too few", each(lambda values: values[[0, -1]]), mode_count
    yield "too early", snapshots(*(full[field][early] for field in FIELDS)), mode_count
    yield "duplicated", each(lambda values: np.repeat(values, 2, axis=0)), mode_count
    yield "one missing", each(lambda values: np.delete(values, len(values) // 2, 0)), mode_count
    yield "single precision", each(lambda values: values.astype(np.float32)), mode_count
    yield (
        "rank-deficient",
        snapshots(shares @ velocity[few], lifted.density(scene, shares @ strain)),
        mode_count,
    )
    yield "more modes than particles", each(lambda values: values), scene.particle_count + 1
    yield "not a number", spoilt(np.nan), mode_count
    yield "infinite", spoilt(np.inf), mode_count
    yield "density not positive", snapshots(velocity, negative), mode_count
    yield "all zero", each(np.zeros_like), mode_count
    yield (
        "all at rest",
        snapshots(np.zeros_like(velocity), np.tile(scene.density0(), (len(density), 1))),
        mode_count,
    )
    yield "no snapshots", each(lambda values: values[:0]), mode_count


def noisy(
    scene: Scene, taken: Arrays, noise_levels: Sequence[float], rng: np.random.Generator
) -> Iterator[dict[str, np.ndarray]]:
    """Snapshots with noise of each level, white in space and time.

    Parameters are those of `study`.
    """
    moving = taken["velocity_snapshots"], lifted.strain(scene, taken["density_snapshots"])
    noise = [np.sqrt(np.mean(field**2)) * rng.standard_normal(field.shape) for field in moving]
    for level in noise_levels:
        velocity, strain = (field + level * own for field, own in zip(moving, noise, strict=True))
        yield {"velocity_snapshots": velocity, "density_snapshots": lifted.density(scene, strain)}


def judge(
    scene: Scene, snapshots: Arrays, full: Arrays, mode_count: int
) -> tuple[int, float, float, str]:
    """What becomes of ``lifted_exact`` with these snapshots.

    Parameters are those of `study`.

    Returns
    -------
    rank, error, bound, outcome
        As in `study`.
    """
    try:
        modes = lifted_rom.decompose(scene, snapshots)
    except ValueError as refusal:
        return 0, np.nan, np.nan, str(refusal)
    rank = len(modes["scaled_velocity_modes"])
    run = lifted_rom.build(scene, modes, mode_count).prepare("lifted_exact").run()
    if (broken := run.breakdown()) is not None:
        return rank, np.inf, np.inf, str(broken)

    def difference(part):
        return tuple(own - full[name][part] for name, own in run.fields(part).items())

    error = energy_norms(scene, difference)
    size = energy_norms(scene, lambda part: (full["velocity"][part], full["strain"][part])).max()
    bound, _ = error_bound.error_bounds(run)
    holds = np.all(error <= bound + ROUNDING * size)
    return rank, share(error.max(), size), share(bound.max(), size), OUTCOMES[bool(holds)]


def original_error(scene: Scene, snapshots: Arrays, full: Arrays, mode_count: int) -> float:
    """Error of the original model with these snapshots; infinite if it broke down.

    Parameters are those of `study`, but for

    full : dict
        velocity and density (times, N) of full SPH.
    """
    modes = pod.decompose({"x": scene.positions, **snapshots})
    run = galerkin(scene, "original", modes, mode_count).prepare(scene.error_steps).run()
    if run.breakdown() is not None:
        return np.inf

    def strained(velocity, density):
        return velocity, lifted.strain(scene, density)

    def whole(part):
        return strained(full["velocity"][part], full["density"][part])

    def difference(part):
        own = strained(*run.fields(part).values())
        return tuple(mine - other for mine, other in zip(own, whole(part), strict=True))

    return share(energy_norms(scene, difference).max(), energy_norms(scene, whole).max())


def energy_norms(
    scene: Scene, fields: Callable[[slice], tuple[np.ndarray, np.ndarray]]
) -> np.ndarray:
    """Energy norm (times,) of velocity and strain, which come a few times of the scene at once."""
    mass, stiffness = lifted.energy_weights(scene)
    norms = np.empty(scene.error_times.size)
    for part in blocks(norms.size):
        velocity, strain = fields(part)
        norms[part] = np.hypot(
            np.linalg.norm(mass * velocity, axis=1), np.linalg.norm(stiffness * strain, axis=1)
        )
    return norms


STUDY = Study(
    datasets={
        "poor_snapshots": Dataset(
            compute="studies.poor_snapshots.study",
            message="{scene}: models of poor snapshots, from {sampling}",
            of_sampling=True,
            reads={"taken": "snapshots.nc", "full": "../lifted_full.nc"},
            arguments={
                "noise_levels": "stability.noise_levels",
                "mode_count": "largest_mode_count",
                "seed": lambda scene, setting: 0,
            },
            needs=STEADY,
            places=lambda config: config["stability"]["poor_snapshots"].items(),
        )
    },
    tables={"poor_snapshots": ("studies.poor_snapshots.rows", "poor_snapshots")},
    drawing=Drawing(
        draw="figures.stability_plots.poor_snapshots",
        caption="Errors and their bounds with poor snapshots: {scene}, snapshots {sampling}.",
        reads={"snapshots": ("poor_snapshots",)},
        places=lambda config: config["stability"]["poor_snapshots"].items(),
    ),
    variables=meanings(
        """
        noise (noise) [1]: noise of the snapshots, of the root mean square of each
        noise_error (noise) [1]: largest energy norm of the error of lifted_exact, of the largest
            norm
        noise_bound (noise) [1]: bound of the same error
        noise_original_error (noise) [1]: the same error of the original model, against full SPH;
            infinite if it broke
        defect (defect_index): what is wrong with snapshots
        defect_mode_count (defect_index) [1] int32: modes asked for
        defect_rank (defect_index) [1] int32: velocity modes that there are
        defect_error (defect_index) [1]: largest energy norm of the error of lifted_exact, NaN if
            refused
        defect_bound (defect_index) [1]: bound of the same error, NaN if refused
        defect_outcome (defect_index): what became of the model
        """
    ),
)
