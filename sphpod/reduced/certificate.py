"""Lifted reduced models beside their full model: errors, their bounds, and models by tolerance.

The bounds are those of `sphpod.reduced.error_bound`, which knows nothing of the full model's
solution.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from sphpod.full import lifted
from sphpod.numerics.error import FIELDS, Arrays, blocks, share
from sphpod.reduced import lifted_rom
from sphpod.reduced.error_bound import FullModel, error_bounds
from sphpod.reduced.sweep import failed, sweep
from sphpod.scene.scene import Scene


def certify(
    scene: Scene, mode_counts: Iterable[int], modes: Arrays, full: Arrays, reference: Arrays
) -> dict[str, np.ndarray]:
    """Errors of ``lifted_exact`` beside their bounds; its coordinates for a single mode count.

    Parameters and errors are those of `lifted_rom.repeat_sph`, but for

    full : dict
        velocity and strain (times, N) of the lifted full model, exact in time.

    Returns
    -------
    dict
        By mode_count, as `dataset.VARIABLES` describes them: {field}_error_reference;
        velocity_error_lifted and strain_error_lifted, relative in the norms of kinetic and of
        elastic energy over all times; energy_error_lifted, energy_error_bound, residual_bound,
        difference_from_best and bound_slack; breakdown_time and modes_resolved. For a single count
        also t, scaled_velocity_coordinates, scaled_strain_coordinates and error_bound (times,).
    """
    counts = list(mode_counts)
    velocity: Seen
    strain: Seen | SeenInTime
    velocity, strain = (
        Seen.of(full[field], scale, modes[f"scaled_{field}_modes"][: max(counts)])
        for field, scale in zip(("velocity", "strain"), lifted.energy_weights(scene), strict=True)
    )
    if (changing := scene.changing("youngs_modulus")) is not None:
        strain = SeenInTime(
            lifted.energy_weights(scene)[1], full["strain"], modes["scaled_strain_modes"],
            changing.at(scene.error_times) / scene.modulus(),
        )  # fmt: skip
    norms = np.sqrt(velocity.total + strain.total)
    best = Best.of(scene, modes)
    operators = None if scene.is_stepped else FullModel.of(scene)
    bounds = {}

    def measure(run):
        reduced = run.coordinates()
        squares = velocity.squares(reduced[0]), strain.squares(reduced[1])
        error = np.sqrt(squares[0] + squares[1])
        bound, plain = error_bounds(run, operators)
        bounds["error_bound"] = bound
        against = lifted_rom.field_errors(run, reference)
        return {
            **{f"{field}_error_reference": error for field, error in against.items()},
            "velocity_error_lifted": part(squares[0], velocity.total),
            "strain_error_lifted": part(squares[1], strain.total),
            "energy_error_lifted": share(error.max(), norms.max()),
            "energy_error_bound": share(bound.max(), norms.max()),
            "residual_bound": share(plain.max(), norms.max()),
            "difference_from_best": best.difference(*reduced),
            "bound_slack": share((bound - error).min(), norms.max()),
        }

    def part(squares, total):
        return share(np.sqrt(squares.sum()), np.sqrt(total.sum()))

    lifted_errors = failed(("velocity", "strain", "energy"), "lifted")
    names = "energy_error_bound", "residual_bound", "difference_from_best"
    columns = failed(FIELDS, "reference") | lifted_errors | dict.fromkeys(names, np.inf)
    runs = lifted_rom.prepare_each(scene, counts, modes, "lifted_exact")
    arrays = sweep(counts, runs, measure, columns | {"bound_slack": np.nan})
    arrays |= bounds if len(counts) == 1 else {}
    return arrays | {"modes_resolved": lifted_rom.modes_resolved(modes, counts)}


def choose(scene: Scene, tolerance: float, modes: Arrays) -> dict[str, np.ndarray]:
    """The smallest ``lifted_exact`` model within a tolerance of the best that the snapshots give.

    Both are held against the largest energy norm of the best model over time. Where the bound,
    which knows of the full model too, is within the tolerance as well, the model is certified.

    Parameters
    ----------
    tolerance : float
        Relative.
    modes : dict
        As from `lifted_rom.decompose`.

    Returns
    -------
    dict
        tolerance; mode_count, modes_resolved and best_mode_count; difference_from_best,
        energy_error_bound, residual_bound, each relative; certified, 1 or 0; t,
        scaled_velocity_coordinates, scaled_strain_coordinates, error_bound (times,).

    Raises
    ------
    Breakdown
        The best model broke down.
    """
    best = Best.of(scene, modes)
    for count in range(1, best.count + 1):
        run = lifted_rom.build(scene, modes, count).prepare("lifted_exact").run()
        if run.breakdown() is not None:
            continue
        difference = best.difference(*run.coordinates())
        if difference <= tolerance:
            break
    bound, plain = error_bounds(run)
    relative = share(bound.max(), best.norm)
    return {
        "tolerance": np.array(tolerance),
        "mode_count": np.array([count]),
        "modes_resolved": lifted_rom.modes_resolved(modes, [count]),
        "best_mode_count": np.array(best.count),
        "difference_from_best": np.array([difference]),
        "energy_error_bound": np.array([relative]),
        "residual_bound": np.array([share(plain.max(), best.norm)]),
        "certified": np.array(int(relative <= tolerance)),
        **run.stored(),
        **run.reduced.system(),
        "error_bound": bound,
    }


def verdict(chosen: Arrays) -> str:
    """What `choose` found, in words."""
    bound, tolerance = chosen["energy_error_bound"][0], chosen["tolerance"]
    relation = "within" if chosen["certified"] else "not within"
    word = "certified" if chosen["certified"] else "not certified"
    reason = f"the bound {bound:.1e} is {relation} {tolerance:g}"
    if np.isnan(bound):
        reason = "nothing moves in it that the bound could be relative to"
    return (
        f"{chosen['mode_count'][0]} modes are within {chosen['difference_from_best'][0]:.1e} of "
        f"the best model; {word}: {reason}"
    )


@dataclass(frozen=True)
class Best:
    """The model with all modes that the snapshots give.

    Attributes
    ----------
    model : LiftedModel
    velocity, strain : arrays, shapes (times, modes)
        Its coordinates.
    norm : float
        Its largest energy norm over time.
    """

    model: lifted_rom.LiftedModel
    velocity: np.ndarray
    strain: np.ndarray
    norm: float

    @classmethod
    def of(cls, scene: Scene, modes: Arrays) -> "Best":
        model = lifted_rom.build(scene, modes)
        velocity, strain = model.prepare("lifted_exact").solve().coordinates()
        return cls(model, velocity, strain, float(model.lengths(velocity, strain).max()))

    @property
    def count(self) -> int:
        """Its velocity modes."""
        return self.velocity.shape[1]

    def difference(self, velocity: np.ndarray, strain: np.ndarray) -> float:
        """Largest energy norm over time of what a smaller model lacks, of the largest norm."""
        rests = []
        for mine, theirs in ((self.velocity, velocity), (self.strain, strain)):
            rests.append(mine.copy())
            rests[-1][:, : theirs.shape[1]] -= theirs
        return share(self.model.lengths(*rests).max(), self.norm)


@dataclass(frozen=True)
class Seen:
    """A scaled field of the full model, seen from modes, at each time.

    Attributes
    ----------
    coordinates : array, shape (times, modes)
    outside, total : arrays, shape (times,)
        Squares of what the modes leave of it, and of all of it.
    """

    coordinates: np.ndarray
    outside: np.ndarray
    total: np.ndarray

    @classmethod
    def of(cls, field: np.ndarray, scale: np.ndarray, modes: np.ndarray) -> "Seen":
        coordinates = np.empty((len(field), len(modes)))
        outside, total = np.empty((2, len(field)))
        for rows in blocks(len(field)):
            scaled = scale * field[rows]
            coordinates[rows] = scaled @ modes.T
            rest = scaled - coordinates[rows] @ modes
            outside[rows] = np.einsum("tx,tx->t", rest, rest)
            total[rows] = np.einsum("tx,tx->t", scaled, scaled)
        return cls(coordinates, outside, total)

    def squares(self, reduced: np.ndarray) -> np.ndarray:
        """Squares of the error of reduced coordinates (times, k) in the first modes, (times,)."""
        rest = self.coordinates.copy()
        rest[:, : reduced.shape[1]] -= reduced
        return np.einsum("tm,tm->t", rest, rest) + self.outside


@dataclass(frozen=True)
class SeenInTime:
    """The scaled strain of the full model, seen from modes, where the modulus changes with time.

    Attributes
    ----------
    scale : array, shape (N,)
        √(V c) at t = 0.
    field : array, shape (times, N)
        The strain.
    modes : array, shape (modes, N)
    moduli : array, shape (times, N)
        The modulus, of that at t = 0.
    """

    scale: np.ndarray
    field: np.ndarray
    modes: np.ndarray
    moduli: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """Squares of all of it in the energy of each time, (times,)."""
        return self.squares(np.zeros((len(self.field), 0)))

    def squares(self, reduced: np.ndarray) -> np.ndarray:
        """Squares of the error of reduced coordinates (times, k) in the first modes, (times,)."""
        found = np.empty(len(self.field))
        for rows in blocks(len(self.field)):
            rest = self.scale * self.field[rows] - reduced[rows] @ self.modes[: reduced.shape[1]]
            found[rows] = np.sum(self.moduli[rows] * rest**2, axis=1)
        return found
