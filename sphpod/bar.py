"""Arrays of a bar with ends, which files hold, and of it with its images, which models see.

Fields of files are those of the bar's own particles. What is a sum over the line becomes one over
the bar, by the number c of bars in a period: energies are divided by c, and their roots, singular
values and coordinates by √c; modes are multiplied by it, so that those of a file are orthonormal
where particles on ends count by half.
"""

from collections.abc import Mapping

import numpy as np

from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import ENERGY_ROOT, VARIABLES, Variable
from sphpod.scene.ends import MATERIAL, STRAIN, VELOCITY
from sphpod.scene.scene import Scene

MODES = "_modes", "_output"
"""How names end of what is multiplied by √c."""

SUMS = "_singular_values", "_coordinates", "reduced_force", "reduced_constant"
"""How names end of what is divided by √c, beside roots of energies."""

ENERGIES = {"J m-2": 2, ENERGY_ROOT: 1}
"""Powers of √c that values of these units are divided by."""


def of_bar(scene: Scene, arrays: Arrays, variables: Mapping[str, Variable] | None = None) -> Arrays:
    """Arrays of the bar, out of those of the line; as they are of a scene without ends.

    Parameters
    ----------
    arrays : dict
        By names of `dataset.VARIABLES`, or of ``variables``.
    variables : dict, optional
    """
    if scene.ends is None:
        return arrays
    known = VARIABLES | dict(variables or {})
    found = {}
    for name, values in arrays.items():
        own = values[..., : scene.bar_count] if "x" in known[name].dims else values
        power = _power(name, known[name])
        found[name] = own * np.sqrt(scene.ends.copies) ** power if power else own
    return found


def of_line(scene: Scene, arrays: Arrays) -> dict[str, np.ndarray]:
    """Arrays of the line, from those of the bar, as `of_bar` gives them.

    Strains of images are those of the bar times their signs, and densities are as these have it.
    Modes are made orthonormal again: rounding has turned those of values near it by more.
    """
    if scene.ends is None:
        return dict(arrays)
    return {name: _with_images(scene, name, values) for name, values in arrays.items()}


def _with_images(scene, name, values):
    meaning = VARIABLES.get(name)
    if meaning is None:
        return values
    if power := _power(name, meaning):
        values = values / np.sqrt(scene.ends.copies) ** power
    if "x" not in meaning.dims:
        return values
    if name == "x":
        return scene.positions
    density0 = scene.density0()
    if name.startswith("density") and not name.endswith(MODES):
        strains = density0[: scene.bar_count] / values - 1
        return density0 / (1 + _reflected(scene, strains, STRAIN))
    kinds = {"velocity": VELOCITY, "strain": STRAIN}
    odd = next((odd for field, odd in kinds.items() if field in name), MATERIAL)
    values = _reflected(scene, values, odd)
    return _orthonormal(values) if name.endswith("_modes") else values


def _reflected(scene, values, odd):
    sources, signs = scene.ends.images(scene.particle_count, odd)
    return values[..., sources] * signs


def _orthonormal(modes):
    columns, shares = np.linalg.qr(modes.T)
    return (columns * np.where(np.diag(shares) < 0, -1.0, 1.0)).T


def _power(name, meaning):
    """Power of √c that values of the line are multiplied by to be those of the bar."""
    return 1 if name.endswith(MODES) else -ENERGIES.get(meaning.units, name.endswith(SUMS))
