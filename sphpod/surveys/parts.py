"""What a reduced model in shared modes is made of, split by what depends on which parameter.

With volumes V, modes v = Φᵀ a, σ = Ψᵀ b and the SPH derivative G, a query's model is

    M a' = -Lᵀ b - D a + F f(t),    S b' = L a,
    M = Φ Vρ0 Φᵀ,  S = Ψ (V/c) Ψᵀ,  L = Ψ V G Φᵀ,  D = Φ Vρ0 d Φᵀ,  F = Φ Vρ0 p,

for a force p(x) f(t). L depends on no parameter. The residuals, scaled by their energies, are

    √(Vρ0) (GΨᵀ b/ρ0 - d Φᵀ a + p f - Φᵀ a'),    √(V/c) (c GΦᵀ a - Ψᵀ b').

Where a parameter only scales ρ0, and d, p and v0 fall apart into terms, the columns of the first
are those of one fixed matrix, whose QR factor is made once, as small as the model, without the loss
of half the digits that a Gram matrix has; so are those of the second where a parameter only scales
c. What does not fall apart is evaluated at the particles in the query.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sphpod.scene.scene import Scene, derivative_matrix, parameter_values
from sphpod.surveys.corrected import Line, bands, scaled
from sphpod.surveys.fields import ParametricField, at_half_cells, at_particles

Values = Mapping[str, float]


@dataclass(frozen=True)
class VelocityPart:
    """All that depends on density, damping, force and start, for ρ0 = g h.

    Each array is to be summed over its terms with their factors, and multiplied by g.

    Attributes
    ----------
    mass : array, shape (K, K)
    damping : array, shape (terms, K, K)
    load, start : arrays, shape (terms, K)
    """

    mass: np.ndarray
    damping: np.ndarray
    load: np.ndarray
    start: np.ndarray


class Operators:
    """Shared modes of a scene with parameters, and what of its models can be prepared.

    Parameters
    ----------
    name : str
    settings : dict
        Resolved settings of the scene.
    shared : dict
        As from `shared_modes.train`: of velocity and stress (modes, N), and translation.
    """

    def __init__(self, name: str, settings: Mapping[str, Any], shared: Mapping[str, Any]) -> None:
        self.name, self.settings = name, dict(settings)
        self.parameters = tuple(settings["parameters"])
        self.nominal = Scene.from_settings(name, self.settings)
        self.rigid = int(shared["translation"])
        self.velocity_modes = np.asarray(shared["velocity_modes"])
        self.stress_modes = np.asarray(shared["stress_modes"])[
            : len(self.velocity_modes) - self.rigid
        ]
        scene = self.nominal
        self.volumes = scene.volumes
        self.pull = np.ascontiguousarray(scene.derivative(self.stress_modes).T)
        self.stretch = np.ascontiguousarray(scene.derivative(self.velocity_modes).T)
        # The derivative of the constant velocity is rounding.
        self.stretch[:, : self.rigid] = 0
        self.coupling = self.stress_modes @ (self.volumes[:, None] * self.stretch)
        self.density = self._field("initial_density")
        self.modulus = self._field("youngs_modulus")
        self.start = self._field("initial_velocity")
        self.damping = self._field("damping") if "damping" in settings else None
        self.load: ParametricField | None = None
        if "force" in settings:
            force = settings["force"]
            shape = force.get("profile", 1) if isinstance(force, Mapping) else 1
            self.load = self._made(shape)

    def _field(self, key):
        return self._made(self.settings[key], at_cells=key == "youngs_modulus")

    def _made(self, text, at_cells=False):
        scene = self.nominal
        constants = {"L": scene.domain_length, "T": scene.duration}
        sample = at_particles(scene.positions)
        if at_cells and scene.interface:
            sample = at_half_cells(scene.positions, scene.spacing / 4, scene.domain_length)
        return ParametricField(str(text), self.parameters, constants, sample)

    @cached_property
    def is_affine(self) -> tuple[bool, bool]:
        """Whether nothing is evaluated at the particles in a query: of velocity and of stress."""
        parts = [f for f in (self.damping, self.load, self.start) if f is not None]
        velocity = self.density.is_one_term and all(f.profiles is not None for f in parts)
        return velocity, self.modulus.is_one_term

    @cached_property
    def damping_is_even(self) -> bool:
        """Whether damping is the same everywhere, so that models fall apart into oscillators."""
        return self.damping is None or self.damping.is_even

    @cached_property
    def gradient(self) -> np.ndarray:
        """The SPH derivative G [1/m] in bands, (N, width)."""
        return bands(derivative_matrix(self.nominal))

    @cached_property
    def _damping_signs(self):
        """Of each term of the damping, its sign if it has one everywhere, else NaN."""
        assert self.damping is not None
        assert self.damping.profiles is not None
        profiles = self.damping.profiles
        low, high = profiles.min(axis=1), profiles.max(axis=1)
        return np.where(low >= 0, 1.0, np.where(high <= 0, -1.0, np.nan))

    def _damping_stays(self, factors):
        """Whether no term of the damping is negative anywhere, whatever the particles are."""
        return bool(np.all((factors * self._damping_signs >= 0) | (factors == 0)))

    @cached_property
    def _velocity(self) -> VelocityPart:
        return self._velocity_of(self.density.shape, *self._profiles)

    @property
    def _profiles(self):
        fields = self.damping, self.load, self.start
        return [self._none if f is None else f.profiles for f in fields]

    @cached_property
    def _compliance(self) -> np.ndarray:
        return self._compliance_of(self.modulus.shape)

    @cached_property
    def velocity_factor(self) -> np.ndarray:
        """QR factor of √(Vh) [GΨᵀ/h, d_j Φᵀ, p_j, v0_j, Φᵀ] for ρ0 = g h."""
        damping, load, start = self._profiles
        density, modes = self.density.shape, self.velocity_modes.T
        columns = [self.pull / density[:, None], *(d[:, None] * modes for d in damping)]
        columns += [load.T, start.T, modes]
        root = np.sqrt(self.volumes * density)[:, None]
        return np.asarray(np.linalg.qr(root * np.concatenate(columns, axis=1), mode="r"))

    @cached_property
    def stress_factor(self) -> np.ndarray:
        """QR factor of [√(Vh) GΦᵀ, √(V/h) Ψᵀ] for c = g h."""
        modulus = self.modulus.shape
        stiff, soft = (
            np.sqrt(part)[:, None] for part in (self.volumes * modulus, self.volumes / modulus)
        )
        columns = [stiff * self.stretch, soft * self.stress_modes.T]
        return np.asarray(np.linalg.qr(np.concatenate(columns, axis=1), mode="r"))

    @property
    def _none(self):
        return np.zeros((0, self.volumes.size))

    def velocity_part(self, values: Values) -> tuple[VelocityPart, float, list[np.ndarray]]:
        """The part, g, and the factors of damping, force and start.

        Raises
        ------
        ValueError
            The density is not positive, or the damping negative, at a particle.
        """
        fields = self.damping, self.load, self.start
        if self.is_affine[0]:
            factors = [np.zeros(0) if f is None else f.factors(values) for f in fields]
            scale = _positive("initial_density", self.density.scale(values))
            if self.damping is not None and not self._damping_stays(factors[0]):
                _not_negative("damping", factors[0] @ self.damping.profiles)
            return self._velocity, scale, factors
        density = self.density.at(values)
        _positive("initial_density", density)
        rows = [self._none if f is None else f.at(values)[None] for f in fields]
        _not_negative("damping", rows[0])
        return self._velocity_of(density, *rows), 1.0, [np.ones(len(r)) for r in rows]

    def compliance(self, values: Values) -> tuple[np.ndarray, float]:
        """g S for c = g h, shape (K', K'), and g.

        Raises
        ------
        ValueError
            The modulus is not positive at a particle.
        """
        if self.is_affine[1]:
            return self._compliance, _positive("youngs_modulus", self.modulus.scale(values))
        modulus = self.modulus.at(values)
        _positive("youngs_modulus", modulus)
        return self._compliance_of(modulus), 1.0

    def _velocity_of(self, density, damping, load, start):
        modes = self.velocity_modes
        weighted = modes * (self.volumes * density)
        return VelocityPart(
            weighted @ modes.T,
            np.array([(weighted * d) @ modes.T for d in damping]).reshape(
                len(damping), *[len(modes)] * 2
            ),
            load @ weighted.T,
            start @ weighted.T,
        )

    def _compliance_of(self, modulus):
        return (self.stress_modes * (self.volumes / modulus)) @ self.stress_modes.T

    def line(self, values: Values, strength: float) -> Line:
        """The lifted full model, of a force of some strength; of the size of the particles."""
        density, modulus, start = (f.at(values) for f in (self.density, self.modulus, self.start))
        damping = 0.0 if self.damping is None else self.damping.at(values)
        force = (self._none if self.load is None else strength * self.load.at(values)[None]).T
        mass, softness = np.sqrt(self.volumes * density), np.sqrt(self.volumes / modulus)
        pull = scaled(self.gradient, mass / density, 1 / softness)
        return Line(pull, mass, softness, damping, mass * start, mass[:, None] * force)

    def least_stiffness(self, values: Values) -> float:
        """The smallest √(V c) of a particle."""
        if self.is_affine[1]:
            return float(np.sqrt(self.modulus.scale(values) * self._softest))
        return float(np.sqrt((self.volumes * self.modulus.at(values)).min()))

    @cached_property
    def _softest(self):
        return (self.volumes * self.modulus.shape).min()

    def point(self, values: Values) -> dict[str, float]:
        """All parameters, of which those that are not given have their nominal values."""
        for name in values:
            if name not in self.parameters:
                allowed = ", ".join(self.parameters)
                raise ValueError(
                    f"{name} = {values[name]}: no such parameter; allowed are {allowed}"
                )
        return parameter_values(self.settings) | {k: float(v) for k, v in values.items()}


def _not_negative(key, field):
    if not np.min(field, initial=0) >= 0:
        raise ValueError(f"{key}: it is {np.min(field):g} somewhere and must not be negative")


def _positive(key, field):
    if not np.min(field) > 0:
        least = np.min(field)
        raise ValueError(f"{key}: it is {least:g} somewhere and must be positive everywhere")
    return field
