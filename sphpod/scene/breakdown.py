"""A run that broke down: how it is reported, and where reduced fields are looked at."""

import numpy as np

from sphpod.numerics.error import blocks

RESOLVED = 0.25
"""Angle [rad] of the fastest wave that outputs may be apart to show a fold of the line.

Between them a strain differs from what they show by less than a hundredth of its amplitude.
"""


class Breakdown(ArithmeticError):
    """A solution became non-finite, or its Jacobian J = ρ0/ρ stopped being positive."""

    def __init__(self, scene_name, model, time, particle):
        super().__init__(
            f"scene {scene_name}: {model} broke down by t = {time:.6g} s at particle {particle}: "
            "its velocity or density is not finite, or its Jacobian rho0/rho is not positive"
        )
        self.time = time
        self.particle = particle


def first_broken(limit, coordinates, modes, rows):
    """Where a reduced field is first not finite or not above a limit, where a cheap test is unsure.

    Parameters
    ----------
    limit : float
    coordinates : array, shape (times, k)
    modes : array, shape (k, N)
    rows : int array
        Ascending rows of the coordinates, the only ones whose field is reconstructed.

    Returns
    -------
    row, particle : ints
        The first such row and the particle that is furthest below; -1 and -1 without one.
    """
    for some in blocks(rows.size):
        with np.errstate(over="ignore", invalid="ignore"):
            fields = coordinates[rows[some]] @ modes
        fields = np.where(fields < np.inf, fields, -np.inf)
        broken = fields.min(axis=1) <= limit
        if broken.any():
            first = int(broken.argmax())
            return int(rows[some][first]), int(fields[first].argmin())
    return -1, -1
