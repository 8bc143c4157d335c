"""A model that is ready to run: what full and reduced models have in common.

All that precedes the time loop is done, so that `Run.run` is the loop alone and can be timed.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np

from sphpod.scene.breakdown import Breakdown
from sphpod.scene.scene import Scene

ALL = slice(None)


@dataclass
class Run(ABC):
    """A model of a scene, with its time steps and outputs.

    Attributes
    ----------
    name : str
        What messages call the model.
    times : array, shape (outputs,)
        [s].
    state : tuple of arrays
        What a run fills; others of the same shapes may be put in their place.
    """

    scene: Scene
    name: str
    times: np.ndarray
    state: tuple[np.ndarray, ...]

    @abstractmethod
    def run(self) -> Self:
        """Fill the state: the time loop, and nothing else."""

    @abstractmethod
    def breakdown(self) -> Breakdown | None:
        """How the last run broke down, if it did."""

    @abstractmethod
    def fields(self, rows: slice = ALL) -> dict[str, np.ndarray]:
        """Velocity [m/s], and density [kg/m³] or strain, of these outputs, (rows, N) each."""

    @abstractmethod
    def stored(self) -> dict[str, np.ndarray]:
        """What a dataset holds of the last run."""

    def solve(self) -> Self:
        """Run.

        Raises
        ------
        Breakdown
            The state became non-finite, or a Jacobian J = ρ0/ρ stopped being positive.
        """
        broken = self.run().breakdown()
        if broken is not None:
            raise broken
        return self

    def broken_at(self, row: int, particle: int) -> Breakdown:
        """How it broke down, of the output and the particle."""
        scene = self.scene
        return Breakdown(scene.name, self.name, self.times[row], scene.bar_particle(particle))


@dataclass
class FullRun(Run):
    """A full model: what it keeps are its fields, velocity and another, (outputs, N) each.

    Attributes
    ----------
    second : {"density", "strain"}
    march : callable
        ``march(velocity, second, watch)`` fills the state and returns -1; or, if a step broke down,
        the flat index of its first broken particle in the row that was to be kept next, which then
        holds the broken state.
    failed : int
        What it returned last.
    """

    second: str
    march: Callable[..., int]
    failed: int = field(default=-1, init=False)

    @classmethod
    def of(cls, scene: Scene, name: str, times: np.ndarray, second: str, march: Any) -> Self:
        """With arrays of its own."""
        velocity, other = np.empty((2, times.size, scene.particle_count))
        return cls(scene, name, times, (velocity, other), second, march)

    def run(self, watch: bool = True) -> Self:
        """Fill the state; without a watch for what breaks, its cost can be measured."""
        self.failed = self.march(*self.state, watch)
        return self

    def breakdown(self) -> Breakdown | None:
        count = self.scene.particle_count
        return self.broken_at(*divmod(self.failed, count)) if self.failed >= 0 else None

    def fields(self, rows: slice = ALL) -> dict[str, np.ndarray]:
        velocity, second = self.state
        return {"velocity": velocity[rows], self.second: second[rows]}

    def stored(self) -> dict[str, np.ndarray]:
        return {"t": self.times, "x": self.scene.positions, **self.fields()}
