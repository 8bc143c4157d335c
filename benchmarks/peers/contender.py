"""What a tool has to offer to be compared: a model to build, to run, and to look at."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

LONG = 20
"""Part of T, 1/20 of it, over which runs are timed that take seconds."""


@dataclass(frozen=True)
class Model:
    """A model ready to run.

    Attributes
    ----------
    prepare : callable
        ``prepare(intervals)`` makes all that precedes a run over the first error intervals; the
        callable it returns is what is timed, and gives the states in the model's own form.
    velocity : callable
        The velocities (outputs, N) [m/s] of such states; not timed.
    steps : int or None
        Time steps in T; None where the tool chooses them or there are none.
    stride : int
        Error intervals from one output to the next.
    """

    prepare: Callable[[int], Callable[[], Any]]
    velocity: Callable[[Any], np.ndarray]
    steps: int | None = None
    stride: int = 1


@dataclass(frozen=True)
class Check:
    """What a full model must agree with before it is compared.

    Attributes
    ----------
    against : {"sph", "exact_in_time"}
        Full SPH with the same explicit Euler steps, or as the time step goes to zero.
    within : float
        Largest relative difference in velocity over T.
    """

    against: str
    within: float


@dataclass(frozen=True)
class Contender:
    """A row of the table.

    Attributes
    ----------
    tool : str
        Name of the tool as a package.
    model, integrator : str
    build : callable
        Makes the model from the scene and its snapshots; its time is the offline time.
    modes : int or None
        Modes for each field; None for full models.
    check : Check or None
        For full models.
    part : int
        The run is timed over 1/part of T, and its time is told for T.
    note : str
    """

    tool: str
    model: str
    integrator: str
    build: Callable[[], Model] = field(repr=False)
    modes: int | None = None
    check: Check | None = None
    part: int = 1
    note: str = ""

    def __str__(self) -> str:
        modes = "" if self.modes is None else f", {self.modes} modes"
        return f"{self.tool}: {self.model}, {self.integrator}{modes}"


EULER = Check("sph", 1e-8)
"""The same steps of the same equations: nothing but rounding."""

LIFTED_EULER = Check("sph", 1e-3)
"""Explicit Euler in strain instead of density: a difference of Δt e²."""

CONVERGED = Check("exact_in_time", 5e-3)
"""Another integrator of the same equations, accurate to less than SPH's own errors."""
