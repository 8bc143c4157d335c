"""Modes that all queries of a survey share: of displacement, and so of its rate, the velocity.

They are the proper modes of the strains of all training runs, each as the displacement u that has
that strain e = G u: those are best for the strain, and as good as any for the velocity.

A velocity that strains nothing no strain shows: the constant one; where an even number of particles
is evenly spaced, one that changes its sign from each to the next; and one of an odd number that is
not. Weighted by mass they are conserved; where density varies, waves carry parts of them.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from sphpod.reduced.pod import modes as proper_modes
from sphpod.scene.scene import Scene, derivative_matrix

Arrays = Mapping[str, np.ndarray]

STILL = 1e-3
"""Strain of a wave, of that of the slowest one, below which it is none."""

BESIDE = 1e-6
"""Norm from which on a velocity is one beside the constant, and strain below which it has none."""

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
        the scenes has momentum, a force or an uneven damping, if the mean velocity is not zero, or
        if particles are uneven, whose momentum moves waves; else there is none. Another velocity
        that strains nothing stands where its size puts it.
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
    still, is_even = _still(scenes[0]), scenes[0].is_even
    mean, other = (_part(velocity, root * each) * slowness for each in (np.ones(root.size), still))
    translates = is_even and (mean > zero or any(scene.translates for scene in scenes))
    constant = np.ones((int(translates or not is_even), root.size))
    rows = _displacements(scenes[0], waves)
    if other > zero:
        place = np.count_nonzero(found.singular_values[: len(rows)] >= other)
        size = np.linalg.norm(rows, axis=1).max(initial=1e-300)
        rows = np.insert(rows, place, size * still, axis=0)
    rows = np.concatenate([constant, rows]) * root
    columns, left = np.linalg.qr(rows.T)
    shares = np.diag(left)
    dependent = np.abs(shares) <= DEPENDENT * np.linalg.norm(rows, axis=1).max(initial=0)
    rank = int(np.argmax(dependent)) if dependent.any() else len(rows)
    modes = (columns * np.sign(shares)).T[:rank] / root
    return {"velocity_modes": modes, "translation": np.array(int(translates))}


def _part(fields, direction):
    """Norm of what fields (times, N) have of a direction (N,), if that is one."""
    size = np.linalg.norm(direction)
    return np.linalg.norm(fields @ direction) / size if size else 0.0


def _still(scene):
    """What a velocity that strains nothing has beside the constant one; zeros if there is none."""
    volumes = scene.volumes
    velocity = np.ones(volumes.size)
    if scene.is_even:
        velocity[1::2] = -1
    else:
        for _ in range(2):
            velocity -= _displacements(scene, scene.derivative(velocity)[None])[0]
    # Of an odd number that is evenly spaced, neighbours at the seam have one sign.
    strain = np.linalg.norm(scene.derivative(velocity)) * volumes.mean()
    beside = velocity - velocity @ volumes / volumes.sum()
    size = np.linalg.norm(beside)
    if size <= BESIDE or strain > BESIDE * size:
        return np.zeros(volumes.size)
    return beside / size


def _displacements(scene, strains):
    """Displacements with strains (modes, N), without what strains next to nothing."""
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import splu

    gradient = derivative_matrix(scene).tocsc()
    least = (STILL * 2 * np.pi / scene.domain_length) ** 2 * eye_array(scene.particle_count)
    return splu((gradient.T @ gradient + least).tocsc()).solve(gradient.T @ strains.T).T
