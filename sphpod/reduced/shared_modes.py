"""Modes of velocity and stress that scenes of one discretisation share, whatever their material.

With the stress σ = c e the lifted equations read m v' = -Gᵀ V σ - m d v + m f and (V/c) σ' = V G v.
Fixed modes v = Φᵀ a, σ = Ψᵀ b, projected in the energy of a scene's own material, give a model of
that scene whose energy nothing but damping and force changes: for any modes and any parameters. It
is the lifted model of the scaled fields √m v and √(V/c) σ in orthonormal modes of the same span.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from sphpod.full import lifted
from sphpod.reduced.lifted_rom import LiftedModel
from sphpod.reduced.pod import modes as proper_modes
from sphpod.scene.scene import Scene

DEPENDENT = 1e-12
"""Part of a mode that others leave over, from which it is one of its own."""

Arrays = Mapping[str, np.ndarray]


def train(solved: Iterable[tuple[Scene, Arrays]]) -> dict[str, np.ndarray]:
    """Modes of the solutions of scenes together.

    Parameters
    ----------
    solved : pairs of a Scene and a dict
        Scenes of the same particles, with velocity (times, N) [m/s] and strain (times, N) of each.

    Returns
    -------
    dict
        velocity_modes and stress_modes (modes, N), orthonormal if summed with the particles'
        volumes; translation, 1 if the first velocity mode is the constant one, which it is if any
        of the scenes has momentum, a force or an uneven damping; else 0.

    Raises
    ------
    ValueError
        The particles of one scene are not those of the first.
    """
    solved = list(solved)
    first = solved[0][0]
    for scene, _ in solved:
        if not np.array_equal(scene.positions, first.positions):
            raise ValueError(
                f"scene {scene.name}: positions: they must be those of scene {first.name}, "
                "as its modes are shared"
            )
    volumes = np.sqrt(first.volumes)
    velocity = np.concatenate([fields["velocity"] for _, fields in solved]) * volumes
    stress = np.concatenate([scene.modulus() * fields["strain"] for scene, fields in solved])
    translates = any(scene.translates for scene, _ in solved)
    constant = (volumes / np.linalg.norm(volumes))[None][: int(translates)]
    # Of a motion that is a translation alone, waves are rounding.
    impedance = max(np.sqrt((scene.density0() * scene.modulus()).max()) for scene, _ in solved)
    size = max(np.linalg.norm(velocity) * impedance, np.linalg.norm(volumes * stress))
    velocity = velocity - velocity @ constant.T @ constant
    found = [
        _ranked(rows, least) / volumes
        for rows, least in ((velocity, size / impedance), (volumes * stress, size))
    ]
    return {
        "velocity_modes": np.concatenate([constant / volumes, found[0]]),
        "stress_modes": found[1],
        "translation": np.array(int(translates)),
    }


def _ranked(rows, size):
    """Proper modes, as many as the numerical rank of the rows, of which some may be rounding."""
    found = proper_modes(rows, None)
    zero = max(rows.shape) * np.finfo(float).eps * size
    return found.modes[: np.count_nonzero(found.singular_values > zero)]


def model(scene: Scene, shared: Arrays, count: int | None = None) -> LiftedModel:
    """Lifted model of a scene in shared modes.

    Parameters
    ----------
    scene : Scene
    shared : dict
        As from `train`.
    count : int, optional
        Velocity modes, to which there is a stress mode for each wave; all there are if not given.

    Raises
    ------
    ValueError
        The modes are not of the scene's particles, or are linearly dependent.
    """
    velocity, rigid = shared["velocity_modes"][:count], int(shared["translation"])
    stress = shared["stress_modes"][: len(velocity) - rigid]
    if velocity.shape[1] != scene.particle_count:
        raise ValueError(
            f"scene {scene.name}: particle_count = {scene.particle_count}: the shared modes are of "
            f"{velocity.shape[1]} particles"
        )
    mass, stiffness = lifted.energy_weights(scene)
    return LiftedModel(
        scene,
        _orthonormal(mass * velocity, scene),
        _orthonormal(stiffness / scene.modulus() * stress, scene),
        rigid,
    )


def _orthonormal(rows, scene):
    """Orthonormal rows of which the first ones span what the first ones given do."""
    columns, left = np.linalg.qr(rows.T)
    shares = np.diag(left)
    if np.any(np.abs(shares) <= DEPENDENT * np.linalg.norm(rows, axis=1)):
        raise ValueError(f"scene {scene.name}: the shared modes are linearly dependent")
    return (columns * np.sign(shares)).T
