"""How far a lifted reduced model is from its full model, told without the full model.

Both are exact in time, with S the own modes of the reduced operator as scaled fields, so that the
reduced solution is S z(t), z' = M z + h f. The error ε = x - S z obeys

    ε' = 𝓐 ε + r,    r = (𝓐 S - S M) z + (F - S h) f,

and as the full operator 𝓐 lets no energy grow, its energy norm is bounded by

    |ε(t)| ≤ |ε(0)| + ∫ |r| ds.

Integrated so, a residual that merely oscillates counts as if it pushed one way all the time. But for
any corrections X of the modes, ε - X z obeys the same equation with the residual

    r_X = (𝓐 (S + X) - (S + X) M) z + (F - (S + X) h) f,

so that also

    |ε(t)| ≤ |X z(t)| + |ε(0) - X z(0)| + ∫ |r_X| ds.

X is chosen to make the sum small: a wave that the residual drives off its own frequency goes into
X, one that it drives in resonance, whose error does grow with time, stays in r_X. Whatever X is, the
bound holds. All norms are of QR factors of the size of the reduced model; a Gram matrix would lose
half their digits.
"""

from dataclasses import dataclass

import numpy as np

from sphpod import lifted
from sphpod.lifted_rom import LiftedModel

CRITICAL = 1e6
"""Condition number of a block's eigenvectors from which its modes are left uncorrected."""


@dataclass(frozen=True)
class Bound:
    """An error bound, ready for any solution of its model.

    Attributes
    ----------
    model : LiftedModel
    corrections : array, shape (coordinates, coordinates)
        QR factor of X.
    residual : array, shape (coordinates + 1, coordinates + 1)
        QR factor of the residual's operator; the last column is that of the force.
    start : array, shape (2N, coordinates)
        S + X, from which the error of the start is taken.
    """

    model: LiftedModel
    corrections: np.ndarray
    residual: np.ndarray
    start: np.ndarray

    def __call__(self, state: np.ndarray) -> np.ndarray:
        """Bound of the error's energy norm at the times of the error integral.

        Parameters
        ----------
        state : array, shape (coordinates, times)
            The model's own coordinates, exact in time.

        Returns
        -------
        array, shape (times,)
        """
        scene = self.model.scene
        mass, _ = lifted.energy_weights(scene)
        initial = np.concatenate([mass * scene.velocity0(), np.zeros(mass.size)])
        error0 = np.linalg.norm(initial - self.start @ state[:, 0])
        return (
            np.linalg.norm(self.corrections @ state, axis=0)
            + error0
            + np.concatenate([[0], np.cumsum(self._residual_integrals(state))])
        )

    def _residual_integrals(self, state):
        """Bounds of ∫ |r| from output to output.

        The norm of what lies linearly between two outputs is convex, so the trapezoidal rule is
        above its integral; what r deviates from that is below Δ²/8 times its second derivative.
        """
        scene, operator = self.model.scene, self.model.own.operator
        interval, times = scene.error_interval, scene.error_times
        push = own_force(self.model)
        amplitude, slope, curvature = np.zeros((3, times.size))
        if push.any() or self.residual[:, -1].any():
            amplitude = scene.force_values(times)[0]
            slope = np.gradient(amplitude, interval)
            curvature = np.gradient(slope, interval)
        factor, last = self.residual[:, :-1], self.residual[:, -1:]
        norms = np.linalg.norm(factor @ state + last * amplitude, axis=0)
        second = factor @ operator @ operator
        bends = np.zeros(times.size)
        # No energy comes into a block without force, so each is largest at an output.
        for coordinates in self.model.own.members:
            largest = np.linalg.norm(second[:, coordinates], 2)
            bends += largest * np.linalg.norm(state[coordinates], axis=0)
        for part, course in (
            (factor @ operator @ push, amplitude),
            (factor @ push, slope),
            (last[:, 0], curvature),
        ):
            bends += np.linalg.norm(part) * np.abs(course)
        bend = np.maximum(bends[:-1], bends[1:])
        return interval / 2 * (norms[:-1] + norms[1:]) + interval**3 / 12 * bend


def bounds(model: LiftedModel) -> tuple[Bound, Bound]:
    """The plain bound, and the one with corrected modes.

    Parameters
    ----------
    model : LiftedModel

    Returns
    -------
    plain, corrected : Bound
        Both hold; the smaller may be taken at each time.
    """
    full = lifted.operator(model.scene)
    modes = own_modes(model)
    residual = full @ modes - modes @ model.own.operator
    corrections = _corrections(model, full, residual)
    return (
        _bound(model, modes, np.zeros_like(modes), residual),
        _bound(
            model,
            modes,
            corrections,
            residual + full @ corrections - corrections @ model.own.operator,
        ),
    )


def own_modes(model: LiftedModel) -> np.ndarray:
    """S: own modes of the model as scaled velocity and strain, shape (2N, coordinates)."""
    kv = len(model.velocity_modes)
    to_modes = model.own.to_modes
    return np.concatenate(
        [model.velocity_modes.T @ to_modes[:kv], model.strain_modes.T @ to_modes[kv:]]
    )


def own_force(model: LiftedModel) -> np.ndarray:
    """h: the force on the own coordinates, shape (coordinates,)."""
    return model.own.from_modes[:, : len(model.velocity_modes)] @ model.force


def _bound(model, modes, corrections, residual):
    _, profile = model.scene.force_values(np.zeros(1))
    mass, _ = lifted.energy_weights(model.scene)
    column = np.zeros(2 * mass.size)
    if profile.size:
        column[: mass.size] = mass * profile
        size = np.linalg.norm(column)
        column -= (modes + corrections) @ own_force(model)
        # A uniform force moves the translation alone, of which nothing is left but rounding.
        column[:] = np.where(np.linalg.norm(column) > 1e-13 * size, column, 0)
    return Bound(
        model,
        np.linalg.qr(corrections, mode="r"),
        np.linalg.qr(np.column_stack([residual, column]), mode="r"),
        modes + corrections,
    )


def _corrections(model, full, residual):
    """X that makes τ |𝓐 X - X M + R| + 2 |X| small, block by block, in the least-squares sense.

    τ is how long the block lasts: T, or the time in which it decays.
    """
    from scipy.sparse import eye_array
    from scipy.sparse.linalg import splu

    corrections = np.zeros_like(residual)
    identity = eye_array(full.shape[0], format="csc")
    for coordinates in model.own.members:
        block = model.own.operator[np.ix_(coordinates, coordinates)]
        values, vectors = np.linalg.eig(block)
        if np.linalg.cond(vectors) > CRITICAL:
            continue
        driven = residual[:, coordinates] @ vectors
        if np.linalg.norm(driven) <= 1e-13 * np.linalg.norm(block):
            continue
        solved = np.zeros(driven.shape, complex)
        for n, value in enumerate(values):
            if value.imag < 0:
                solved[:, n] = solved[:, n - 1].conj()
                continue
            shifted = (full - value * identity).tocsc()
            rest = 2 * max(1 / model.scene.duration, -value.real)
            normal = shifted.conj().T @ shifted + rest**2 * identity
            solved[:, n] = splu(normal.tocsc()).solve(-(shifted.conj().T @ driven[:, n]))
        corrections[:, coordinates] = (solved @ np.linalg.inv(vectors)).real
    return corrections
