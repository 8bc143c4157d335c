"""What is asked of a query, each with an interval that the bound of its error gives.

With ε the bound of the energy norm and u the solution,

- a field at a place is off by at most ε times what a unit of energy norm moves it: 1/√m of a
  particle's velocity, 1/√(V c) of its strain, √(c/V) of its stress; of a sensor that takes the mean
  with weights w, √(Σ w² of their squares);
- the energy by at most ε (|u| + ε/2);
- a maximum lies between the maxima of |value| - bound and of |value| + bound, over all places that
  it is of, each with its own bound;
- a passage between the times at which |value| + bound and |value| - bound reach the level; a time
  that is not reached is NaN.

Times are those of the outputs.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import Variable
from sphpod.surveys.parts import Operators, Values
from sphpod.surveys.query import Answer

UNITS = {"velocity": "m s-1", "strain": "1", "stress": "Pa"}
OF_ENERGY = "J m-2"

VARIES = 1e-6
"""Part of a quantity's size from which on a spread is not taken for rounding."""

Interval = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Value, and the least and the largest that the bound allows: of all outputs, or of one."""


class Question:
    """One quantity of a survey.

    Parameters
    ----------
    asked : dict
        Its keys in the configuration.
    """

    def __init__(self, operators: Operators, asked: Mapping[str, Any]) -> None:
        self.operators, self.asked = operators, dict(asked)
        scene = operators.nominal
        self.times = scene.error_times
        time = asked.get("time", scene.duration)
        self.output = int(np.argmin(np.abs(self.times - time)))
        if "field" in asked:
            self.particles, self.weights, self.firsts = _sensors(scene, asked)

    @property
    def is_curve(self) -> bool:
        """Whether it has a value at each time."""
        return self.asked["kind"] == "history"

    @property
    def variable(self) -> Variable:
        """What its value means, of many queries."""
        kind, dims = self.asked["kind"], ("query", "t") if self.is_curve else ("query",)
        if kind in ("energy", "energy_loss"):
            lost = "lost since the start" if kind == "energy_loss" else "on a unit of cross-section"
            return Variable(dims, OF_ENERGY, f"energy {lost}, at t = {self.times[self.output]:g} s")
        field, place = self.asked["field"], _where(self.asked)
        if kind == "passage":
            level = f"{self.asked['level']:g} {UNITS[field]}"
            return Variable(dims, "s", f"first output at which the {field} {place} reaches {level}")
        what = {
            "history": f"{field} {place}",
            "maximum": f"largest magnitude over time of the {field} {place}",
            "value": f"{field} {place} at t = {self.times[self.output]:g} s",
        }[kind]
        return Variable(dims, UNITS[field], what)

    def answer(self, answer: Answer, values: Values) -> Interval:
        """Value and interval, of shape (times,) of a history and () of what else there is."""
        kind = self.asked["kind"]
        if kind in ("energy", "energy_loss"):
            return self._energy(answer, kind == "energy_loss")
        field, reach = self.sensed(answer, values)
        margin = answer.bound[:, None] * reach
        if kind == "maximum":
            size = np.abs(field)
            return size.max(), max(0.0, (size - margin).max()), (size + margin).max()
        if kind == "passage":
            size = np.abs(field)
            ends = size, size + margin, np.maximum(size - margin, 0)
            found = (self.of_sensors(each) for each in ends)
        else:
            found = (self.of_sensors(each) for each in (field, field - margin, field + margin))
        return tuple(found)  # type: ignore[return-value]

    def of_sensors(self, field: np.ndarray) -> np.ndarray:
        """What is asked of a field (…, times, sensors)."""
        kind = self.asked["kind"]
        if kind == "maximum":
            return np.abs(field).max(axis=(-2, -1))
        one = field[..., 0]
        if kind == "history":
            return one
        if kind == "value":
            return one[..., self.output]
        above = np.abs(one) >= self.asked["level"]
        return np.where(above.any(axis=-1), self.times[above.argmax(axis=-1)], np.nan)

    def of_energy(self, energy: np.ndarray, start: np.ndarray) -> np.ndarray:
        """What is asked of an energy (…, times), of which the first is known better as `start`."""
        now = energy[..., self.output]
        return start - now if self.asked["kind"] == "energy_loss" else now

    @property
    def sensor_count(self) -> int:
        """Sensors that a field is asked of."""
        return len(self.firsts) if "field" in self.asked else 0

    def sensors(self, values: Values) -> np.ndarray:
        """Of many queries, sensors as vectors in the coordinates of `Operators.unit_inertia`.

        Returns
        -------
        array, shape (queries, sensors, k)
            One that serves all queries, but for sensors of stress.
        """
        at, weights = self.particles, self.weights[None, :]
        if self.asked["field"] == "stress":
            weights = weights * self.operators.modulus.each(values, at)
        modes = self.operators.shapes[self.asked["field"] != "velocity"][:, at]
        return np.swapaxes(self._summed(modes * weights[:, None, :]), 1, 2)

    def sensed(self, answer: Answer, values: Values) -> tuple[np.ndarray, np.ndarray]:
        """The field at the sensors, (times, sensors), and how far a unit of energy norm moves it.

        Over all particles it is the one quantity that costs as many operations as there are.
        """
        operators, at, weights = self.operators, self.particles, self.weights
        volumes, query = operators.volumes[at], answer.query
        if self.asked["field"] == "velocity":
            coordinates, modes = answer.coordinates[0], operators.velocity_modes
            shares, squares = weights, weights**2 / (operators.density.some(values, at) * volumes)
        else:
            coordinates, modes = answer.coordinates[1], operators.strain_modes
            modulus = operators.modulus.some(values, at)
            shares = weights if self.asked["field"] == "strain" else weights * modulus
            squares = shares**2 / (modulus * volumes)
        shapes = self._summed(modes[: len(query.start), at] * shares)
        field = np.linalg.multi_dot([coordinates, query.velocity_modes, shapes])
        return field, np.sqrt(self._summed(squares))

    def _summed(self, parts):
        """Sums over the particles of each sensor, of what the last axis is along them."""
        return np.add.reduceat(parts, self.firsts, axis=-1)

    def _energy(self, answer, lost):
        norm, bound = answer.norms[self.output], answer.bound[self.output]
        energy, off = norm**2 / 2, bound * (norm + bound / 2)
        low, high = max(0.0, energy - off), energy + off
        if not lost:
            return energy, low, high
        begun = answer.start_norm**2 / 2
        return begun - energy, begun - high, begun - low

    def of_fields(self, scene: Any, fields: Arrays, energy: np.ndarray) -> Any:
        """The same of a full solution: velocity and strain (times, N), and energy (times,)."""
        kind = self.asked["kind"]
        if kind in ("energy", "energy_loss"):
            return self.of_energy(energy, energy[0])
        strain = fields["strain"]
        field = {"velocity": fields["velocity"], "strain": strain}.get(self.asked["field"])
        field = scene.modulus() * strain if field is None else field
        return self.of_sensors(self._summed(field[:, self.particles] * self.weights))


def _where(asked):
    """Where a quantity is taken, in words."""
    if asked.get("places") == "all":
        return "at any particle"
    if len(places := asked.get("places", [asked.get("place")])) > 5:
        return f"at any of {len(places)} places"
    return f"at x = {' or '.join(f'{place:g}' for place in places)} m"


def _sensors(scene, asked):
    """Particles of all sensors, their parts of the means, and where each sensor begins."""
    places = asked.get("places", [asked.get("place")])
    if places == "all":
        every = np.arange(scene.particle_count)
        return every, np.ones(every.size), every
    found = [_sensor(scene, place, asked.get("width", 0)) for place in places]
    particles, weights = (np.concatenate(each) for each in zip(*found, strict=True))
    firsts = np.cumsum([0] + [len(each) for each, _ in found])[:-1]
    return particles, weights, firsts


def _sensor(scene, place, width):
    """Particles that a sensor covers, at least the nearest, and their parts of its mean."""
    length, positions = scene.domain_length, scene.positions
    away = np.abs((positions - place + length / 2) % length - length / 2)
    covered = np.flatnonzero(away <= width / 2 * (1 + 1e-12))
    if covered.size < 2:
        return np.array([int(np.argmin(away))]), np.ones(1)
    weights = scene.volumes[covered]
    return covered, weights / weights.sum()


def questions(operators: Operators, asked: Mapping[str, Any]) -> dict[str, Question]:
    """All quantities of a survey, by name."""
    return {name: Question(operators, each) for name, each in asked.items()}
