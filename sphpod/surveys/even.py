"""The lifted full model where ρ0, c and d are the same everywhere: its Fourier modes, one by one.

With G exp(iθj) = i g exp(iθj), the speed of waves s = √(c/ρ0) and ω = s g, the spectra of velocity
and of i s e are that of the initial velocity times α and β,

    α' = -d α + ω β + f(t),    β' = -ω α,

from α = 1 without f, and that of the force's profile times α and β, from α = 0 with it. One
transform serves all times, and only what is asked for is transformed back: where the coefficients
of a survey are even, this full model competes with any reduced one.
"""

import numpy as np

from sphpod.numerics import propagator
from sphpod.surveys.parts import Operators, Values
from sphpod.surveys.query import Survey


def is_even(operators: Operators) -> bool:
    """Whether coefficients are the same everywhere for all parameters, and spacing is."""
    even = operators.density.is_even and operators.modulus.is_even
    return even and operators.damping_is_even and operators.nominal.is_even


class Waves:
    """The waves of a scene with parameters.

    Parameters
    ----------
    survey : Survey
        Of a scene that `is_even`.
    particles : int array
        Where fields are asked for.
    outputs : int array
        Of which times the energy is asked for.
    """

    def __init__(self, survey: Survey, particles: np.ndarray, outputs: np.ndarray) -> None:
        self.survey, self.operators, self.outputs = survey, survey.operators, outputs
        scene = self.operators.nominal
        count = scene.particle_count
        modes = np.arange(count // 2 + 1)
        self.symbol = np.fft.rfft(scene.derivative(np.eye(1, count)[0])).imag
        # Of all waves those of rfft are half, but for the mean and the sawtooth.
        self.shares = np.where((modes == 0) | (2 * modes == count), 1, 2) / count
        turns = 2j * np.pi / count * np.outer(modes, particles)
        self.shapes = self.shares[:, None] * np.exp(turns)

    def solve(self, values: Values) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity and strain (times, particles), and the energy (outputs,) [J/m²]."""
        operators, scene = self.operators, self.operators.nominal
        density, modulus = (
            float(field.some(values, np.zeros(1, int))[0])
            for field in (operators.density, operators.modulus)
        )
        damping = operators.damping
        decay = 0.0 if damping is None else float(damping.some(values, np.zeros(1, int))[0])
        speed = np.sqrt(modulus / density)
        courses, strength = self.survey.courses(values)
        spectra = [np.fft.rfft(operators.start.at(values))]
        if courses and operators.load is not None:
            spectra.append(strength * np.fft.rfft(operators.load.at(values)))
        modes, times = self.symbol.size, scene.error_times.size
        pairs = np.zeros((len(spectra), modes, 2, 2))
        pairs[..., 0, 0] = -decay
        pairs[..., 0, 1] = speed * self.symbol
        pairs[..., 1, 0] = -pairs[..., 0, 1]
        pushed = np.zeros((len(courses), len(spectra) * modes, 2))
        pushed[:, modes:, 0] = 1
        state = np.zeros((2, len(spectra), modes, times))
        state[0, 0, :, 0] = 1
        propagator.prepare(
            pairs.reshape(-1, 2, 2), 0, pushed, scene.error_interval, times, courses
        ).run(state.reshape(-1, times))
        shapes = np.array([spectrum[:, None] * self.shapes for spectrum in spectra])
        velocity, strain = (
            np.tensordot(part, rows, ([0, 1], [0, 1]))
            for part, rows in zip(state, (shapes.real, shapes.imag / speed), strict=True)
        )
        then = np.einsum("sm,psmt->pmt", spectra, state[..., self.outputs])
        mass = density * scene.volumes[0]
        energy = mass / 2 * self.shares @ (np.abs(then) ** 2).sum(axis=0)
        return velocity, strain, energy
