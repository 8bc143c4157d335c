"""Arrays by name as an `xarray.Dataset`, with units and meanings, and back."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sphpod.bar import of_bar, of_line
from sphpod.pipeline.dataset import VARIABLES
from sphpod.scene.scene import Scene

if TYPE_CHECKING:
    import xarray

Data = Mapping[Any, Any]
"""An `xarray.Dataset`, or arrays by the same names."""


def labelled(
    scene: Scene | None, arrays: Mapping[str, Any], attributes: Mapping[str, Any] | None = None
) -> "xarray.Dataset":
    """Arrays as a dataset, with dimensions, units and meanings of `dataset.VARIABLES`.

    Of a bar with ends it holds the bar alone, as files do (`sphpod.bar`).
    """
    import xarray

    named = {"scene": scene.name} if scene else {}
    if scene and scene.ends:
        arrays, named = of_bar(scene, arrays), {**named, "boundary": str(scene.ends)}
    variables = {}
    for name, values in arrays.items():
        meaning = VARIABLES[name]
        texts = {"units": meaning.units, "long_name": meaning.long_name}
        if meaning.dtype is not str:
            values = np.asarray(values, meaning.dtype)
        variables[name] = meaning.dims, values, {key: text for key, text in texts.items() if text}
    found = xarray.Dataset(variables, attrs={**named, **(attributes or {})})
    times = {VARIABLES[name].coordinates for name in arrays} & set(arrays)
    return found.set_coords(sorted(times))


def arrays_of(scene: Scene | None, what: str, data: Data, *needed: str) -> dict[str, np.ndarray]:
    """Arrays of a dataset by name, of the times and particles of the scene where there is one.

    Of a bar with ends they are those of it and its images.

    Raises
    ------
    ValueError
        One that is needed is missing, or they are of other times or particles; the message names
        the data by ``what``.
    """
    variables = getattr(data, "variables", data)
    if missing := [name for name in needed if name not in variables]:
        raise ValueError(
            f"{f'scene {scene.name}: ' if scene else ''}{what} holds {', '.join(variables)}, "
            f"but not {missing[0]}"
        )
    arrays = {name: np.asarray(values) for name, values in variables.items()}
    if scene is None:
        return arrays
    for name, key, expected in (
        ("x", "particle_count", scene.positions[: scene.bar_count]),
        ("t", "error_interval", scene.error_times),
    ):
        if name in arrays and not np.array_equal(arrays[name], expected):
            raise ValueError(
                f"scene {scene.name}: {what}: its {arrays[name].size} values of {name} are not the "
                f"{expected.size} of the scene (see {key})"
            )
    return of_line(scene, arrays)
