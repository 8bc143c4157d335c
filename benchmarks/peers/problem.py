"""The scene that all tools solve, its solutions that they are compared with, and its snapshots."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import yaml
from scipy.integrate import cumulative_simpson
from scipy.sparse import csr_array

from sphpod.full import sph
from sphpod.reduced.snapshots import extract
from sphpod.reference import exact
from sphpod.scene.kernel import neighbour_lists
from sphpod.scene.scene import Scene

CONFIG = "config/config.yaml"
SCENE = "ten_harmonics"
MODES = 12

SAMPLINGS = {
    "half a period": {"range": [0, 1.6], "count": 100},
    "a period": {"range": [0, 3.2], "count": 200},
    "a period, densely": {"range": [0, 3.2], "count": 3200},
}
"""The first is uniform100 of the configuration; the period is L √(ρ0/c) = 3.16 s."""


@dataclass(frozen=True)
class Problem:
    """A scene without damping and force, of uniform material.

    Attributes
    ----------
    scene : Scene
    density0, modulus : arrays, shape (N,)
        ρ0 [kg/m³] and c [Pa].
    gradient : csr_array, shape (N, N)
        The SPH derivative G [1/m], G_ij = V_j ∇W_ij.
    """

    scene: Scene
    density0: np.ndarray
    modulus: np.ndarray
    gradient: csr_array

    @classmethod
    def load(cls) -> "Problem":
        """Read the scene from the configuration.

        Raises
        ------
        ValueError
            The scene has damping or a force, or its material is not uniform.
        """
        with open(CONFIG, encoding="utf-8") as file:
            scene = Scene.from_settings(SCENE, yaml.safe_load(file)["scenes"][SCENE])
        density0, modulus = scene.density0(), scene.modulus()
        forced = scene.damping_values().size or scene.forces
        if forced or np.ptp(density0) or np.ptp(modulus):
            raise ValueError(
                f"scene {SCENE}: the tools are set up for uniform material, no d, no f"
            )
        count = scene.particle_count
        first, neighbours, weights = neighbour_lists(
            scene.positions,
            np.full(count, scene.spacing),
            scene.smoothing_length,
            scene.domain_length,
        )
        index = neighbours.astype(np.int32), first.astype(np.int32)
        return cls(scene, density0, modulus, csr_array((weights, *index), shape=(count, count)))

    @property
    def count(self) -> int:
        """Number N of particles."""
        return self.scene.particle_count

    @property
    def intervals(self) -> int:
        """Number of error intervals in T; every tool is asked for its state after each."""
        return self.scene.error_times.size - 1

    @cached_property
    def solution(self) -> dict[str, np.ndarray]:
        """Full SPH of this project, explicit Euler; velocity and density (times, N)."""
        return sph.solve(self.scene, self.scene.error_steps)

    @cached_property
    def exact(self) -> np.ndarray:
        """Exact velocity (times, N) of the line of masses, springs and dampers [m/s]."""
        return exact.solve(self.scene)["velocity"]

    @cached_property
    def exact_in_time(self) -> np.ndarray:
        """Velocity (times, N) that SPH tends to as its time step goes to zero [m/s].

        In velocity and strain SPH is linear, and G a convolution: every Fourier mode swings by
        itself, with √(c/ρ0) times the symbol of G.
        """
        symbol = np.fft.fft(self.gradient[:, [0]].toarray().ravel()).imag[: self.count // 2 + 1]
        frequency = np.sqrt(self.modulus[0] / self.density0[0]) * symbol
        swings = np.cos(np.outer(self.scene.error_times, frequency))
        return np.fft.irfft(np.fft.rfft(self.scene.velocity0()) * swings, n=self.count, axis=1)

    def snapshots(self, sampling: str) -> dict[str, np.ndarray]:
        """Snapshots of full SPH, one a row, by the sampling's name."""
        return extract(self.scene, SAMPLINGS[sampling], self.solution)

    def displacements(self, sampling: str) -> np.ndarray:
        """Displacements (n, N) [m] at the velocity snapshots' times, integrated from velocities."""
        times = self.snapshots(sampling)["velocity_time"]
        sums = cumulative_simpson(
            self.solution["velocity"], dx=self.scene.error_interval, axis=0, initial=0
        )
        return sums[np.rint(times / self.scene.error_interval).astype(int)]
