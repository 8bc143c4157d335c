"""Modes of the snapshots of several samplings together, of one scene or of several.

A scene is so reduced on what others do: on modes of one run that serve another, or of several runs
that serve what lies between them. The particles are the same in all; densities at rest may differ,
so strains are each those of the snapshot's own scene.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from sphpod.full import lifted
from sphpod.numerics.error import FIELDS, Arrays
from sphpod.reduced import lifted_rom, pod
from sphpod.scene.scene import Scene


def decompose(snapshots: Sequence[Arrays]) -> dict[str, np.ndarray]:
    """Modes and singular values of velocity and of density snapshots of all samplings.

    Parameters
    ----------
    snapshots : sequence of dicts
        Of each sampling, as in `pod.decompose`.

    Returns
    -------
    dict
        As from `pod.decompose`.

    Raises
    ------
    ValueError
        As `pod.decompose`.
    """
    return pod.decompose(_together(snapshots, FIELDS))


def decompose_lifted(
    scene: Scene, snapshots: Sequence[Arrays], sources: Iterable[Mapping[str, Any]]
) -> dict[str, np.ndarray]:
    """Modes of velocity and strain of all samplings, orthonormal in the energy of the scene.

    Parameters
    ----------
    snapshots : sequence of dicts
        Of each sampling, as in `lifted_rom.decompose`.
    sources : dicts
        Settings of each sampling's scene.

    Returns
    -------
    dict
        As from `lifted_rom.decompose`.

    Raises
    ------
    ValueError
        As `lifted_rom.decompose`.
    """
    strained = []
    for taken, settings in zip(snapshots, sources, strict=True):
        source = Scene.from_settings(scene.name, dict(settings))
        strains = {
            f"strain_{kind}": lifted.strain(source, pod.checked(name, taken[name], 0))
            for kind in ("snapshots", "twins")
            if (name := f"density_{kind}") in taken
        }
        strained.append({**taken, **strains})
    return lifted_rom.decompose(scene, _together(strained, ("velocity", "strain")))


def _together(snapshots, fields):
    """All snapshots and twins; where a sampling has no twins, its snapshots are their own."""
    arrays = {"x": snapshots[0]["x"]}
    for name in fields:
        own = [taken[f"{name}_snapshots"] for taken in snapshots]
        twins = [taken.get(f"{name}_twins", taken[f"{name}_snapshots"]) for taken in snapshots]
        arrays[f"{name}_snapshots"] = np.concatenate(own)
        arrays[f"{name}_twins"] = np.concatenate(twins)
    return arrays
