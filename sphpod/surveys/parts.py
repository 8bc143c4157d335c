"""What a reduced model in shared modes is made of, split by what depends on which parameter.

With volumes V, modes v = Φᵀ a, displacement coordinates q and the SPH derivative G, a query's
strain is e = G Φᵀ q exactly, and its model

    M a' = -K q - D a + F f(t),    q' = a,
    M = Φ Vρ0 Φᵀ,  K = (GΦᵀ)ᵀ V c GΦᵀ,  D = Φ Vρ0 d Φᵀ,  F = Φ Vρ0 p,

for a force p(x) f(t). The residual is of velocity alone, and orthogonal to the modes: what the
scaled columns

    √(Vρ0) (G c GΦᵀ q/ρ0 - d Φᵀ a + p f)

have beside √(Vρ0) Φᵀ. Where a parameter only scales ρ0, and c, d, p and v0 fall apart into terms,
all these are sums of matrices that are made once; of the columns, and those of the modes by which
the bound is sharpened, it is a QR factor, as small as the model, without the loss of half the
digits that a Gram matrix has. What does not fall apart is
evaluated at the particles in the query.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular

from sphpod.scene.scene import Scene, derivative_matrix
from sphpod.surveys.corrected import Line
from sphpod.surveys.fields import ParametricField, at_half_cells, at_particles

Values = Mapping[str, float]

DEPENDENT = 1e-12
"""Part of a mode that those before leave over, from which it is one of its own."""


@dataclass(frozen=True)
class Inertia:
    """All that depends on density, damping, force and start, for some ρ0, in energy coordinates.

    With the Cholesky factor M = C Cᵀ these are Cᵀ a and Cᵀ q. Damping, force and start are to be
    summed over their terms.

    Attributes
    ----------
    modes : array, shape (k, k)
        C⁻¹: coordinates of energy to those in the shared modes, a = C⁻ᵀ â.
    damping : array, shape (terms, k, k)
    load, start : arrays, shape (terms, k)
    """

    modes: np.ndarray
    damping: np.ndarray
    load: np.ndarray
    start: np.ndarray


@dataclass(frozen=True)
class Residual:
    """Scaled columns of some modes and all correction modes, behind them, as rows of a QR factor.

    Attributes
    ----------
    modes : array, shape (k + m or fewer, k + m)
        Of the modes themselves, as far down as they are not zero.
    pull : array, shape (terms, rows, k + m)
        Of the displacement, by terms of the modulus.
    damping : array, shape (terms, rows, k + m)
        Of the velocity; of no terms where damping is the same everywhere.
    load, start : arrays, shape (rows, terms)
    stiffness : array, shape (terms, m, m)
        K of the correction modes.
    """

    modes: np.ndarray
    pull: np.ndarray
    damping: np.ndarray
    load: np.ndarray
    start: np.ndarray
    stiffness: np.ndarray


class Operators:
    """Shared modes of a scene with parameters, and what of its models can be prepared.

    Parameters
    ----------
    name : str
    settings : dict
        Resolved settings of the scene.
    shared : dict
        As from `training.train`: velocity_modes (modes, N), translation, and correction_modes
        (m, N), without which bounds are of corrections at the particles.
    """

    def __init__(self, name: str, settings: Mapping[str, Any], shared: Mapping[str, Any]) -> None:
        self.name, self.settings = name, dict(settings)
        self.parameters = tuple(settings["parameters"])
        self.nominal = Scene.from_settings(name, self.settings)
        self.rigid = int(shared["translation"])
        self.velocity_modes = np.asarray(shared["velocity_modes"])
        self.volumes = self.nominal.volumes
        self.correction_modes = shared.get("correction_modes")
        self.strain_modes = self.nominal.derivative(self.velocity_modes)
        # The derivative of the constant velocity is rounding.
        self.strain_modes[: self.rigid] = 0
        self._residuals: dict[int, Residual] = {}
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
    def is_affine(self) -> bool:
        """Whether nothing is evaluated at the particles in a query."""
        return self._inertia_is_affine and self.modulus.profiles is not None

    @cached_property
    def _inertia_is_affine(self):
        parts = [f for f in (self.damping, self.load, self.start) if f is not None]
        return self.density.is_one_term and all(f.profiles is not None for f in parts)

    @cached_property
    def damping_is_even(self) -> bool:
        """Whether damping is the same everywhere, so that models fall apart into oscillators."""
        return self.damping is None or self.damping.is_even

    @cached_property
    def oscillates(self) -> bool:
        """Whether nothing pushes, damping is even, and parameters only scale the density."""
        is_even = self._inertia_is_affine and self.damping_is_even and self.load is None
        return is_even and self.modulus.is_elementwise

    @cached_property
    def gradient(self) -> Any:
        """The SPH derivative G [1/m], a scipy.sparse array (N, N)."""
        return derivative_matrix(self.nominal).tocsr()

    def inertia(self, values: Values) -> tuple[Inertia, float, list[np.ndarray]]:
        """All that density is in, of the shape h of ρ0 = g h; g; factors of damping, force, start.

        Raises
        ------
        ValueError
            The density is not positive, or the damping negative, at a particle; or the modes are
            linearly dependent.
        """
        fields = self.damping, self.load, self.start
        _check("initial_density", self.density, values)
        if self.damping is not None:
            _check("damping", self.damping, values)
        if self._inertia_is_affine:
            factors = [np.zeros(0) if f is None else f.factors(values) for f in fields]
            return self.unit_inertia, abs(float(self.density.factors(values)[0])), factors
        rows = [self._none if f is None else f.at(values)[None] for f in fields]
        return (
            self._inertia_of(self.density.at(values), *rows),
            1.0,
            [np.ones(len(r)) for r in rows],
        )

    def stiffness(self, values: Values, modes: np.ndarray) -> np.ndarray:
        """K in the coordinates of energy that `Inertia.modes` are given of, (k, k).

        Raises
        ------
        ValueError
            The modulus is not positive at a particle.
        """
        _check("youngs_modulus", self.modulus, values)
        if self.is_affine:
            return np.tensordot(self.modulus.factors(values), self.stiffnesses, 1)
        return modes @ self._stiffness_of(self.modulus.at(values)) @ modes.T

    def residual(self, count: int) -> Residual:
        """Of the first modes, where all coefficients fall apart and ρ0 = h.

        Modes are the coordinates of `unit_inertia`.
        """
        if count not in self._residuals:
            self._residuals[count] = self._residual(count)
        return self._residuals[count]

    def _residual(self, count):
        modulus, (damping, load, start) = self.modulus.profiles, self._profiles
        assert modulus is not None
        density, (velocities, strains) = self._shape, self.corrections
        modes, strained = (
            np.concatenate([each[:count], more])
            for each, more in zip(self.shapes, (velocities, strains), strict=True)
        )
        pulls = [self.nominal.derivative(c * strained) / density for c in modulus]
        # Even damping of the modes leaves nothing beside them.
        damping = damping[:0] if self.damping_is_even else damping
        parts = [modes, *pulls, *(d * modes for d in damping), load, start]
        columns = np.sqrt(self.volumes * density) * np.concatenate(parts)
        factor = np.linalg.qr(columns.T, mode="r")
        ends = np.cumsum([len(part) for part in parts])[:-1]
        first, *each, loads, starts = np.split(factor, ends, axis=1)
        by_term = np.reshape(each, (len(each), len(factor), len(modes)))
        pull, damped = by_term[: len(pulls)], by_term[len(pulls) :]
        stiffness = np.array([(strains * (self.volumes * c)) @ strains.T for c in modulus])
        return Residual(first[: len(modes)], pull, damped, loads, starts, stiffness)

    @cached_property
    def corrections(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities and strains of the correction modes, orthonormal for ρ0 = h, (m, N) each."""
        root = np.sqrt(self.volumes * self._shape)
        assert self.correction_modes is not None
        velocities = np.linalg.qr((self.correction_modes * root).T)[0].T / root
        return velocities, self.nominal.derivative(velocities)

    @cached_property
    def _shape(self):
        """h of a density ρ0 = g h."""
        assert self.density.profiles is not None
        return np.abs(self.density.profiles[0])

    @cached_property
    def unit_inertia(self) -> Inertia:
        """Of the shape h of a density ρ0 = g h."""
        return self._inertia_of(self._shape, *self._profiles)

    @cached_property
    def shapes(self) -> tuple[np.ndarray, np.ndarray]:
        """Velocities and strains of the coordinates of `unit_inertia`, (k, N) each."""
        into = self.unit_inertia.modes
        return into @ self.velocity_modes, into @ self.strain_modes

    @cached_property
    def start_factor(self) -> np.ndarray:
        """QR factor of √(Vh) v0_j, (rows, terms)."""
        return self._factor_of(self.start)

    @cached_property
    def _load_factor(self):
        return self._factor_of(self.load)

    def _factor_of(self, field):
        root = np.sqrt(self.volumes * self._shape)
        return np.asarray(np.linalg.qr((root * field.profiles).T, mode="r"))

    @cached_property
    def stiffnesses(self) -> np.ndarray:
        """K of each term of the modulus, in the coordinates of `unit_inertia`, (terms, k, k)."""
        assert self.modulus.profiles is not None
        modes = self.unit_inertia.modes
        return np.array([modes @ self._stiffness_of(c) @ modes.T for c in self.modulus.profiles])

    def norms(self, values: Values, strength: float) -> tuple[float, float]:
        """Energy norms of the initial velocity, and of the profile of a force of some strength."""
        if self._inertia_is_affine:
            root = np.sqrt(abs(float(self.density.factors(values)[0])))
            mass, start = root, self.start_factor @ self.start.factors(values)
            pushed = 0.0 if self.load is None else self._load_factor @ self.load.factors(values)
        else:
            mass = np.sqrt(self.volumes * self.density.at(values))
            start = self.start.at(values)
            pushed = 0.0 if self.load is None else self.load.at(values)
        return float(np.linalg.norm(mass * start)), float(np.linalg.norm(mass * strength * pushed))

    @property
    def _profiles(self):
        fields = self.damping, self.load, self.start
        return [self._none if f is None else f.profiles for f in fields]

    @property
    def _none(self):
        return np.zeros((0, self.volumes.size))

    def _inertia_of(self, density, damping, load, start):
        weights = self.volumes * density
        into = _inverse_cholesky((self.velocity_modes * weights) @ self.velocity_modes.T)
        modes = into @ self.velocity_modes
        weighted = modes * weights
        damped = [(weighted * d) @ modes.T for d in damping]
        shape = len(damping), len(modes), len(modes)
        return Inertia(into, np.reshape(damped, shape), load @ weighted.T, start @ weighted.T)

    def _stiffness_of(self, modulus):
        return (self.strain_modes * (self.volumes * modulus)) @ self.strain_modes.T

    def line(self, values: Values, strength: float) -> Line:
        """The lifted full model, of a force of some strength; of the size of the particles."""
        density, modulus, start = (f.at(values) for f in (self.density, self.modulus, self.start))
        damping = 0.0 if self.damping is None else self.damping.at(values)
        force = (self._none if self.load is None else strength * self.load.at(values)[None]).T
        mass, stiffness = np.sqrt(self.volumes * density), np.sqrt(self.volumes * modulus)
        stretch = (self.gradient * stiffness[:, None] / mass).tocsr()
        return Line(stretch, mass, damping, mass * start, mass[:, None] * force)

    def least_stiffness(self, values: Values) -> float:
        """What √(V c) of no particle is below."""
        return float(np.sqrt(self.volumes.min() * self.modulus.least(values)))


def _check(key, field, values):
    least = field.least(values)
    if key == "damping":
        if not least >= 0:
            raise ValueError(f"{key}: it is {least:g} somewhere and must not be negative")
    elif not least > 0:
        raise ValueError(f"{key}: it is {least:g} somewhere and must be positive everywhere")


def _inverse_cholesky(matrix):
    try:
        lower = np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        raise ValueError("the shared modes are linearly dependent") from None
    if np.any(np.diag(lower) <= DEPENDENT * np.sqrt(np.diag(matrix))):
        raise ValueError("the shared modes are linearly dependent")
    return solve_triangular(lower, np.eye(len(lower)), lower=True, check_finite=False)
