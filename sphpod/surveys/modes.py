"""Modes that all queries of a survey share: of displacement, and so of its rate, the velocity.

They are the proper modes of the strains of all training runs, each as the displacement u that has
that strain e = G u: those are best for the strain, and as good as any for the velocity.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from sphpod.reduced.pod import modes as proper_modes
from sphpod.scene.scene import Scene, derivative_matrix

Arrays = Mapping[str, np.ndarray]

STILL = 1e-3
"""Strain of a wave, of that of the slowest one, below which it is none."""

DEPENDENT = 1e-8
"""Part that those before leave over of a mode, of the largest one, from which it is its own."""


def shared_modes(solved: Iterable[tuple[Scene, Arrays]]) -> dict[str, np.ndarray]:
    """Modes of the solutions of scenes together, whatever their material is.

    Parameters
    ----------
    solved : pairs of a Scene and a dict
        Scenes of the same particles, with velocity (times, N) [m/s] and strain (times, N) of each.

    Returns
    -------
    dict
        velocity_modes (modes, N), orthonormal if summed with the particles' volumes; translation, 1
        if the first one is the constant velocity and strains nothing. It is the first one if any of
        the scenes has momentum, a force or an uneven damping, or if particles are uneven, whose
        momentum moves waves; else there is none.
    """
    solved = list(solved)
    scenes, root = [scene for scene, _ in solved], np.sqrt(solved[0][0].volumes)
    strain, velocity = (
        root * np.concatenate([fields[name] for _, fields in solved])
        for name in ("strain", "velocity")
    )
    # Of a motion that is a translation alone, waves are rounding.
    slowness = max(np.sqrt((scene.density0() / scene.modulus()).max()) for scene in scenes)
    size = max(np.linalg.norm(strain), np.linalg.norm(velocity) * slowness)
    found = proper_modes(strain, None)
    zero = max(strain.shape) * np.finfo(float).eps * size
    waves = found.modes[: np.count_nonzero(found.singular_values > zero)] / root
    translates = any(scene.translates for scene in scenes)
    constant = np.ones((int(translates or not scenes[0].is_even), root.size))
    rows = np.concatenate([constant, _displacements(scenes[0], waves)]) * root
    columns, left = np.linalg.qr(rows.T)
    shares = np.diag(left)
    dependent = np.abs(shares) <= DEPENDENT * np.linalg.norm(rows, axis=1).max(initial=0)
    rank = int(np.argmax(dependent)) if dependent.any() else len(rows)
    modes = (columns * np.sign(shares)).T[:rank] / root
    return {"velocity_modes": modes, "translation": np.array(int(translates))}


def _displacements(scene, strains):
    """Displacements with strains (modes, N), without what strains next to nothing."""
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import splu

    gradient = derivative_matrix(scene).tocsc()
    least = (STILL * 2 * np.pi / scene.domain_length) ** 2 * eye_array(scene.particle_count)
    return splu((gradient.T @ gradient + least).tocsc()).solve(gradient.T @ strains.T).T
