"""A survey that has been trained, as a function of its parameters."""

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sphpod.numerics.error import Arrays
from sphpod.pipeline import dataset
from sphpod.surveys import samples, unbounded
from sphpod.surveys.answers import answer_all, of_settings, variables

if TYPE_CHECKING:
    import xarray


class LoadedSurvey:
    """What `load_survey` gives: call it with parameters.

    Attributes
    ----------
    ranges : dict
        Of each parameter its nominal value, range, and scale or distribution.
    """

    def __init__(self, settings: Mapping[str, Any], model: Arrays, path: str = "") -> None:
        self.path = path
        self.ranges: dict[str, Any] = settings["physics"]["parameters"]
        self._tolerance = settings["survey"]["tolerance"]
        self._survey, self._asked = of_settings(
            settings["scene"], settings["physics"], settings["survey"], model
        )

    def __repr__(self) -> str:
        ranges = ", ".join(
            f"{name}: {given['range'][0]:g} to {given['range'][1]:g}"
            for name, given in self.ranges.items()
        )
        return f"<survey of {ranges}; quantities {', '.join(self._asked)}>"

    def __call__(
        self, /, *, bounds: bool = True, extrapolate: bool = False, **parameters: Any
    ) -> "xarray.Dataset":
        """Quantities with their intervals, bounds and estimates.

        Parameters
        ----------
        bounds : bool
            Whether errors are bounded; the quantities alone come many times as fast.
        extrapolate : bool
            Whether values outside the ranges of the parameters are answered.
        **parameters
            Numbers or arrays, which broadcast together; nominal values where left out.

        Returns
        -------
        xarray.Dataset
            One row a query, along ``query``; without that dimension if all are numbers.

        Raises
        ------
        ValueError
            No such parameter, or a value outside its range.
        """
        for name in parameters:
            if name not in self.ranges:
                allowed = ", ".join(self.ranges)
                raise ValueError(f"{name}: no such parameter; allowed are {allowed}")
        nominal = {name: given["nominal"] for name, given in self.ranges.items()}
        given = np.broadcast_arrays(
            *(np.asarray(value, float) for value in (nominal | parameters).values())
        )
        points = np.stack([array.ravel() for array in given], axis=1)
        for point in points:
            values = dict(zip(self.ranges, map(float, point), strict=True))
            told = samples.outside(self.ranges, values)
            if told and not extrapolate:
                raise ValueError(f"{told}; extrapolate=True answers it")
        if bounds:
            found = answer_all(self._survey, self._asked, points, self._tolerance)
        else:
            found = unbounded.answer_all(self._survey, self._asked, points)
        labelled = self._labelled(found)
        return labelled.isel(query=0) if given[0].ndim == 0 else labelled

    def _labelled(self, found):
        import xarray

        meanings = dataset.VARIABLES | variables(self._asked, self.ranges)
        return xarray.Dataset(
            {
                name: (
                    meanings[name].dims,
                    np.asarray(values, meanings[name].dtype),
                    {"long_name": meanings[name].long_name, "units": meanings[name].units},
                )
                for name, values in found.items()
            }
        ).set_coords([*self.ranges, "t"])


def load_survey(path: str | os.PathLike[str]) -> LoadedSurvey:
    """The trained model of a survey, ``results/surveys/{name}/model.nc``, to ask more of.

    Parameters
    ----------
    path : path of the file

    Returns
    -------
    LoadedSurvey
        A function of the parameters.

    Raises
    ------
    ValueError
        The file is not, byte by byte, what the workflow wrote, or holds no survey.
    """
    settings, model = dataset.settings(path), dataset.read(path)
    if "survey" not in settings or "mode_count" not in model:
        raise ValueError(f"{path}: it holds no survey; one is in results/surveys/{{name}}/model.nc")
    return LoadedSurvey(settings, model, str(path))
