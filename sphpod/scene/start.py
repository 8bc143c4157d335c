"""A state that a scene starts from: velocity and strain of a time that a file of a run holds.

The time is the scene's t = 0, and what it starts from strains it; without one a scene starts from
v0 and unstrained. Between the particles, where only references look, it is a periodic cubic spline.
"""

import os
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sphpod.numerics.expressions import Expression
from sphpod.scene.ends import STRAIN, VELOCITY, Ends

NEAR = 1e-6
"""Part of a time by which one may be beside what is asked for, as single precision rounds."""

BESIDE = 1e-3
"""Part of a spacing by which the same particle may be at another place."""

AT_REST = 1e-9
"""Part of the largest value that one at an end may be, as it is rounded."""


class Kept(Expression):
    """A field that is known at the particles, in the place of an expression in x.

    Parameters
    ----------
    text : str
        How messages quote it.
    places, values : arrays, shape (N,)
    length : float
        Period [m].
    """

    def __init__(self, text: str, places: np.ndarray, values: np.ndarray, length: float):
        from scipy.interpolate import CubicSpline

        self.text, self.variables, self.constants, self.terms = text, ("x",), {}, 1
        self.given = places, values, length
        closed = np.append(places, places[0] + length), np.append(values, values[0])
        self.spline = CubicSpline(*closed, bc_type="periodic")

    def __reduce__(self) -> tuple:
        return Kept, (self.text, *self.given)

    def __call__(self, **arrays: np.ndarray) -> np.ndarray:
        """Values at places x [m]; at the particles the very ones that are kept."""
        return self.spline(np.asarray(arrays["x"], np.float64) % self.given[2])


@dataclass(frozen=True, eq=False)
class Start:
    """What a scene starts from.

    Attributes
    ----------
    velocity, strain : Kept
        v [m/s] and e = ρ0/ρ - 1.
    density : array, shape (N,)
        ρ [kg/m³].
    """

    velocity: Kept
    strain: Kept
    density: np.ndarray

    @classmethod
    def read(
        cls,
        given: Mapping[str, Any],
        places: np.ndarray,
        length: float,
        density0: np.ndarray,
        ends: Ends | None,
    ) -> "Start":
        """The state that ``start`` of a scene asks for.

        Parameters
        ----------
        given : dict
            from, a NetCDF file of velocity and density or strain at t and x; and t [s].
        places, density0 : arrays, shape (N,)
            Particles of the line and their ρ0.
        length : float
            Period of the line [m].
        ends : Ends or None

        Raises
        ------
        ValueError
            There is no such file, it lacks one of these, or the time, or is of other particles, not
            finite, or folded; the message is key, value and what is allowed.
        """
        count = places.size if ends is None else places.size // ends.copies + 1
        velocity, density, strain = _state(given, places[:count], density0[:count])
        if ends:
            velocity, strain = (
                _on_line(given, ends, places.size, field, odd)
                for field, odd in ((velocity, VELOCITY), (strain, STRAIN))
            )
            density = np.append(density, (density0 / (1 + strain))[count:])
        text = f"{given['from']} at t = {given['t']}"
        fields = [Kept(text, places, values, length) for values in (velocity, strain)]
        return cls(fields[0], fields[1], density)

    @property
    def checksum(self) -> str:
        """Of the state alone, whatever else its file holds."""
        (_, velocity, _), density = self.velocity.given, self.density
        return f"{zlib.crc32(density.tobytes(), zlib.crc32(velocity.tobytes())):08x}"


def _state(given, places, density0):
    """Velocity, density and strain of particles that a file has at a time."""
    import netCDF4

    path, asked = given["from"], given["t"]
    if not os.path.isfile(path):
        raise _refused("from", path, "there is no such file")
    try:
        file = netCDF4.Dataset(path)
    except OSError:
        raise _refused("from", path, "there is no NetCDF file") from None

    def read(name, row=...):
        try:
            return np.ma.filled(np.ma.asarray(file[name][row]).astype(float), np.nan)
        except (ValueError, RuntimeError):
            raise _refused("from", path, f"its {name} is damaged, or no numbers") from None

    with file:
        second = "density" if "density" in file.variables else "strain"
        for name in ("t", "x", "velocity", second):
            if name not in file.variables:
                held = ", ".join(file.variables) or "nothing"
                raise _refused("from", path, f"it holds {held}, but not {name}")
        times, x = read("t"), read("x")
        shape = times.size, places.size
        for name in ("velocity", second):
            if file[name].shape != shape:
                needed = f"needed are {times.size} times of {places.size} particles"
                raise _refused("from", path, f"{name} is of shape {file[name].shape}; {needed}")
        spacing = np.diff(places).min()
        if not np.isfinite(times).all() or not times.size:
            raise _refused("from", path, "its t must be finite, and hold a time at least")
        if x.shape != places.shape or not (np.abs(x - places) <= BESIDE * spacing).all():
            there = f"x is of shape {x.shape}"
            if x.shape == places.shape:
                n = int(np.argmin(np.abs(x - places) <= BESIDE * spacing))
                there = f"particle {n} is at x = {x[n]:.9g}, and at {places[n]:.9g} here"
            raise _refused("from", path, f"it is of other particles: {there}")
        row = int(np.argmin(np.abs(times - asked)))
        if not abs(times[row] - asked) <= NEAR * asked:
            held = f"its times are {times[0]:g} to {times[-1]:g}, the nearest {times[row]:.9g}"
            raise _refused("t", asked, f"the file {path} does not hold it; {held}")
        velocity, other = read("velocity", row), read(second, row)
    least = 0 if second == "density" else -1
    if not np.isfinite(velocity).all() or not (np.isfinite(other) & (other > least)).all():
        must = f"velocity must be finite, and {second} finite and above {least}, everywhere"
        raise _refused("t", asked, f"{must} in {path}")
    if second == "density":
        return velocity, other, density0 / other - 1
    return velocity, density0 / (1 + other), other


def _on_line(given, ends, count, field, odd):
    """A field of a bar on all of the line, about ends of a kind odd, and so zero on them."""
    sources, signs = ends.images(count, odd)
    there = np.abs(field[sources[signs == 0]]).max(initial=0)
    if there > AT_REST * np.abs(field).max():
        what = "velocity" if odd == VELOCITY else "strain"
        allowed = f"its {what} at an end that is {odd} is {there:g}, and must be 0"
        raise _refused("from", given["from"], allowed)
    return field[sources] * signs


def _refused(key, value, allowed):
    return ValueError(f"start.{key} = {value}: {allowed}")
