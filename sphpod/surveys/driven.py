"""The bound of a query's error in general: of any force, and of any damping."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from sphpod.numerics.course import Course
from sphpod.reduced.error_bound import Bound, Map, over_time
from sphpod.scene.scene import Scene


@dataclass(frozen=True)
class _Norms:
    """What `over_time` asks of a full model, as norms alone."""

    scene: Scene
    start: np.ndarray
    courses: tuple[Course, ...]
    forces: np.ndarray

    @property
    def missed(self) -> float:
        return float(sum(self.forces[0, n] * one.missed for n, one in enumerate(self.courses)))


def driven_bound(
    query: Any,
    rows: np.ndarray,
    damping: np.ndarray | float,
    beside: float,
    sizes: tuple[float, float],
    change: np.ndarray | None = None,
) -> np.ndarray:
    """Bound of the energy norm of the error at the outputs, (times,).

    Parameters
    ----------
    query : Query
    rows : array, shape (rows, coordinates + forces)
        The residual by own coordinates and force.
    damping : float or array, shape (rows,)
        Of the rows, as far as it is known there; else 0 [1/s].
    beside : float
        Energy norm of the initial velocity that the modes do not hold.
    sizes : pair of floats
        Energy norms of the initial velocity and of the force's profile.
    change : array, shape (any, coordinates), optional
        Of the modes that the residual is of.
    """
    push, forces = query.push, len(query.courses)
    full = _Norms(query.scene, np.array([sizes[0]]), query.courses, np.full((1, forces), sizes[1]))

    def mapped(rows):
        return Map.of(query, push, rows)

    lasting = np.broadcast_to(damping, len(rows))
    damped = lasting * query.scene.duration >= 1
    taken = rest = changed = None
    if damped.any():
        taken = mapped(rows[damped] / (2 * np.sqrt(lasting[damped, None])))
        rest = mapped(rows[~damped])
    if change is not None:
        changed = mapped(np.pad(change, ((0, 0), (0, forces))))
    bound = Bound(beside, changed, mapped(rows), taken, rest)
    (over,) = over_time(full, query, query.own_start, [bound], 0.0)
    return over + full.missed
