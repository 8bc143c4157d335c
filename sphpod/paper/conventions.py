"""The paper's unsaid and misprinted conventions, and what its numbers become without them.

Each study below changes one convention, and compares a number of the paper with what comes out
with the convention and without it. What results already hold is read, the rest is computed here.

Long: one function for each convention, all of one form.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from sphpod.full import sph
from sphpod.numerics.compiled import compiled
from sphpod.numerics.error import relative_error
from sphpod.paper.paper import FIELDS, Arrays, Paper
from sphpod.reference import exact, reference
from sphpod.scene import kernel
from sphpod.scene.scene import IN_X, Scene

EULER, LINEAR_DENSITY, IMPLICIT_DAMPING, VELOCITY_FIRST, DENSITY_FIRST, HEUN = range(6)
"""Time steppings: the paper's, and others."""


class Row(NamedTuple):
    """One number, with a convention and without it; None stands for what there is not."""

    convention: str
    scene: str | None
    quantity: str
    paper: float | None
    with_convention: float | None
    without_convention: float | None
    variant: str
    erratum: int | None = None


def table(config: Mapping[str, Any], read: Callable[..., Arrays]) -> list[Row]:
    """All studies.

    Parameters
    ----------
    config : dict
        Resolved configuration.
    read : callable
        As in `Paper`.
    """
    paper = Paper(config, read)
    return [row for study in STUDIES for row in study(paper)]


def changed_errors(
    paper: Paper,
    convention,
    scene,
    variant,
    *,
    sph=None,
    reference=None,
    against="fd",
    erratum=None,
) -> Iterator[Row]:
    """Errors of full SPH in both fields, with another solution in place of it, of its reference
    ``against``, or of both."""
    for field, symbol in FIELDS.items():
        solution = sph or paper.read(f"{scene}/sph.nc", field)
        other = reference or paper.read(f"{scene}/reference_{against}.nc", field)
        yield Row(
            convention,
            scene,
            f"error of {symbol} against {against}",
            paper.printed_error(scene, field, against),
            paper.error(scene, field, against),
            relative_error(solution[field], other[field]),
            variant,
            erratum,
        )


# Full SPH -----------------------------------------------------------------------------------------


def time_stepping(paper: Paper) -> Iterator[Row]:
    """What the rates of a step are taken from."""
    euler = "explicit Euler: both rates from the old state"
    for convention, name, stepping, variant in (
        (euler, "three_harmonics", VELOCITY_FIRST, "velocity first, then density from the new one"),
        (euler, "three_harmonics", DENSITY_FIRST, "density first, then velocity from the new one"),
        (euler, "three_harmonics", HEUN, "Heun's method"),
        ("rate of density with ρ²", "three_harmonics", LINEAR_DENSITY, "with ρ0²"),
        ("damping of the old velocity", "damped", IMPLICIT_DAMPING, "of the new velocity"),
    ):
        solution = solve_otherwise(paper.scene(name), stepping)
        yield from changed_errors(paper, convention, name, variant, sph=solution)
    scene = paper.scene("damped_forced")
    ends = replace(scene, forces=scene.later(scene.time_step).forces)
    solution = sph.solve(ends, scene.error_steps)
    convention = "force at the start of a step"
    yield from changed_errors(paper, convention, scene.name, "at its end", sph=solution)


def smoothing_ratio(paper: Paper) -> Iterator[Row]:
    """Smoothing ratios other than 1.04."""
    for name, ratio, variant, erratum in (
        ("three_harmonics", 1.04, "α = 1.04, as printed", 2),
        ("three_harmonics", 2, "α = 2, three neighbours on each side", 9),
        ("gaussian_coarse", 1.04, "α = 1.04, as in most scenes", None),
    ):
        scene = paper.scene(name, smoothing_ratio=ratio)
        solution = sph.solve(scene, scene.error_steps)
        yield from changed_errors(paper, "α = 1.06", name, variant, sph=solution, erratum=erratum)


def larger_smoothing_ratio(paper: Paper) -> Iterator[Row]:
    """Section 3.2 says that a larger α could help; none does."""
    convention = "α = 1.04; a larger one does not help"
    coefficients = {
        "β": ("derivative_coefficient", kernel.derivative_coefficient),
        "dispersion coefficient": ("dispersion_coefficient", kernel.dispersion_coefficient),
    }
    for ratio in (1.06, 1.2, 1.25, 6**0.5 - 1):
        variant = f"α = {ratio:.5g}"
        scene = paper.scene("ten_harmonics", smoothing_ratio=ratio)
        solution = sph.solve(scene, scene.error_steps)
        yield from changed_errors(paper, convention, scene.name, variant, sph=solution, erratum=9)
        for quantity, (kind, coefficient) in coefficients.items():
            printed = paper.printed(None, kind=kind, smoothing_ratio=1.04)
            values = coefficient(1.04), coefficient(ratio)
            yield Row(convention, None, quantity, printed, *values, variant, 9)


def modulus(paper: Paper) -> Iterator[Row]:
    """Modulus of two_moduli: of SPH where the halves meet, and of the reference at x = 0."""
    scene = paper.scene("two_moduli")
    convention = "c = 0.15 in SPH where the halves meet, the mean of the half cells"
    printed = paper.scene(scene.name, interface=None)
    mean_of_halves: Any = OfPlace(partial(_harmonic_mean, scene))
    harmonic = replace(printed, youngs_modulus=mean_of_halves)
    for variant, changed in (("c as printed", printed), ("the harmonic mean", harmonic)):
        solution = sph.solve(changed, changed.error_steps)
        for against in ("fd", "exact"):
            yield from changed_errors(
                paper, convention, scene.name, variant, sph=solution, against=against, erratum=5
            )
    of_its_half: Any = OfPlace(partial(_modulus_at_seam, scene))
    solution = reference.solve_paper(replace(scene, youngs_modulus=of_its_half))
    convention = "c(0) = 0.2 in the reference"
    yield from changed_errors(paper, convention, scene.name, "c(0) = 0.1", reference=solution)


@dataclass(frozen=True)
class OfPlace:
    """A function of x in the place of an expression."""

    function: Callable[..., np.ndarray]
    variables: tuple[str, ...] = IN_X
    text: str = "a function"

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.function(x)


def _modulus_at_seam(scene, x):
    """The modulus, at x = 0 that of the half which begins there."""
    return scene.youngs_modulus(x=np.where(x == 0, scene.spacing / 4, x))


def _harmonic_mean(scene, x):
    quarter = scene.spacing / 4
    left = scene.youngs_modulus(x=(x - quarter) % scene.domain_length)
    return 2 / (1 / left + 1 / scene.youngs_modulus(x=x + quarter))


def wavenumber(paper: Paper) -> Iterator[Row]:
    """The undefined l in the initial velocity of two_moduli."""
    name = "two_moduli"
    printed = paper.scene(name)
    with_short_waves: Any = OfPlace(partial(_half_as_long, printed))
    scene = replace(printed, initial_velocity=with_short_waves)
    solution, changed = sph.solve(scene, scene.error_steps), reference.solve_paper(scene)
    convention = "l = 1 in the initial velocity"
    yield from changed_errors(
        paper, convention, name, "l = 2", sph=solution, reference=changed, erratum=5
    )


def _half_as_long(scene, x):
    """The initial velocity with all its waves half as long."""
    return scene.initial_velocity(x=2 * x)


# References and errors ----------------------------------------------------------------------------


def exact_reference(paper: Paper) -> Iterator[Row]:
    """References that the paper calls analytic."""
    for scene, erratum in (
        ("three_harmonics", 3),
        ("gaussian_coarse", 3),
        ("gaussian", 3),
        ("ten_harmonics", 12),
    ):
        for field, symbol in FIELDS.items():
            yield Row(
                "the reference is the finite-difference solution",
                scene,
                f"error of {symbol}",
                paper.printed_error(scene, field, "fd"),
                paper.error(scene, field, "fd"),
                paper.error(scene, field, "exact"),
                "the exact solution",
                erratum,
            )


def reference_resolution(paper: Paper) -> Iterator[Row]:
    """Nodes of the reference where the paper calls it analytic."""
    scene = paper.scene("three_harmonics")
    finer = paper.scene(
        scene.name, particle_count=2 * scene.particle_count, time_step=scene.time_step / 2
    )
    solution = reference.solve_paper(finer)
    changed = {field: solution[field][:, ::2] for field in FIELDS}
    convention, variant = "two nodes of the reference per particle, Δt/2", "four nodes, Δt/4"
    yield from changed_errors(paper, convention, scene.name, variant, reference=changed)


def density_shift(paper: Paper) -> Iterator[Row]:
    """Density of the reference, which lives a quarter of a particle spacing to the left."""
    convention, variant = "ρ of the reference taken where v is", "brought back by Δx/4"
    for scene in ("three_harmonics", "damped"):
        density = paper.read(f"{scene}/reference_fd.nc", "density")["density"]
        centred = _shifted(density, -1 / 4)
        solution = paper.read(f"{scene}/sph.nc", "density")["density"]
        truth = paper.read(f"{scene}/reference_exact.nc", "density")["density"]
        yield Row(
            convention,
            scene,
            "error of ρ against fd",
            paper.printed_error(scene, "density", "fd"),
            paper.error(scene, "density", "fd"),
            relative_error(solution, centred),
            variant,
            4,
        )
        yield Row(
            convention,
            scene,
            "error of the reference's ρ against exact",
            None,
            paper.error(scene, "density", "exact", "fd"),
            relative_error(centred, truth),
            variant,
            4,
        )


def _shifted(field, cells):
    """A periodic field (times, N) moved to the right by a fraction of a cell, by its spectrum."""
    spectrum = np.fft.rfft(field, axis=1)
    phase = np.exp(-2j * np.pi * np.arange(spectrum.shape[1]) * cells / field.shape[1])
    return np.fft.irfft(spectrum * phase, field.shape[1], axis=1)


def rounded_beta(paper: Paper) -> Iterator[Row]:
    """β of the modified reference; a modulus larger by β² makes waves faster by β."""
    scene = "high_frequency"
    text = paper.config["scenes"][scene]["youngs_modulus"]
    changed = exact.solve(paper.scene(scene, youngs_modulus=f"({text})*1.022**2"))
    solution = paper.read(f"{scene}/sph.nc", "velocity")["velocity"]
    yield Row(
        f"β = {kernel.derivative_coefficient(paper.scene(scene).smoothing_ratio):.7f} unrounded",
        scene,
        "error of v against modified",
        paper.printed_error(scene, "velocity", "modified"),
        paper.error(scene, "velocity", "modified"),
        relative_error(solution, changed["velocity"]),
        "β = 1.022 as printed",
        13,
    )


def error_norm(paper: Paper) -> Iterator[Row]:
    """Square root, and the times that the error is summed over."""
    scene, field = "three_harmonics", "velocity"
    error = paper.error(scene, field, "fd")
    yield Row(
        "relative L2 error with the square root",
        scene,
        "error of v against fd",
        paper.printed_error(scene, field, "fd"),
        error,
        error**2,
        "without it, as printed",
        1,
    )
    scene = "damped"
    a, b = (paper.read(f"{scene}/{file}.nc", field)[field] for file in ("sph", "reference_fd"))
    half = np.ones((len(a), 1))
    half[[0, -1]] = np.sqrt(0.5)
    for variant, x, y in (
        ("half weight at both ends (trapezoidal rule)", half * a, half * b),
        ("t = 0 left out", a[1:], b[1:]),
        ("every 0.01 s", a[::10], b[::10]),
    ):
        yield Row(
            "error summed over t = 0, 0.001, …, 10 s, equal weights",
            scene,
            "error of v against fd",
            paper.printed_error(scene, field, "fd"),
            paper.error(scene, field, "fd"),
            relative_error(x, y),
            variant,
        )


# POD ----------------------------------------------------------------------------------------------


def snapshots(paper: Paper) -> Iterator[Row]:
    """When snapshots are taken, and what is done with them."""
    scene = "three_harmonics"
    data = paper.read(f"{scene}/uniform100/snapshots.nc", "velocity_time", "density_snapshots")
    times, density = data["velocity_time"], data["density_snapshots"]
    yield Row(
        "snapshots spaced by range/count, right end excluded",
        scene,
        "spacing of uniform100 [s]",
        0.016,
        float(times[1] - times[0]),
        1.6 / 99,
        "right end included",
    )
    values = [np.linalg.svd(a, compute_uv=False) for a in (density, density - density.mean(axis=0))]
    whole, varying = (float(v[0] / v[1]) for v in values)
    quantity = "first density singular value over the second"
    convention = "no mean subtracted from the snapshots"
    yield Row(convention, scene, quantity, None, whole, varying, "mean subtracted")
    shorter, longer = (
        float(paper.sweep("ten_harmonics", name)["velocity_error_sph"].min())
        for name in ("uniform15", "half_period_15")
    )
    yield Row(
        "uniform15 is over [0, 1.5]",
        "ten_harmonics",
        "least POD error of v",
        None,
        shorter,
        longer,
        "over [0, 1.6], as printed",
        11,
    )


def mode_numbers(paper: Paper) -> Iterator[Row]:
    """How many modes a mode count takes, and when POD works."""
    scene = "three_harmonics"
    sweep = paper.sweep(scene, "minimal")
    modes = list(sweep["mode_count"])
    for field, symbol in FIELDS.items():
        errors = sweep[f"{field}_error_sph"]
        yield Row(
            "k modes of each field, or all there are (minimal: 3 of v, 4 of ρ)",
            scene,
            f"POD error of {symbol}, minimal",
            None,
            float(errors[modes.index(4)]),
            float(errors[modes.index(3)]),
            "3 modes of each",
            10,
        )
    scene = "ten_harmonics"
    limits = {field: paper.error(scene, field, "fd") for field in FIELDS}
    some, onwards = [], []
    for count in range(15, 21):
        sweep = paper.sweep(scene, f"half_period_{count}")
        works = np.all([sweep[f"{f}_error_sph"] < limits[f] for f in FIELDS], axis=0)
        some += [count] if works.any() else []
        onwards += [count] if works[-1] else []
    yield Row(
        "a number of snapshots works if for some k both POD errors are below the SPH errors",
        scene,
        "smallest number that works",
        paper.printed(scene, kind="smallest_working_count"),
        min(some, default=None),
        min(onwards, default=None),
        "for the largest k too",
    )


# Misprints in the model ---------------------------------------------------------------------------


def chain(paper: Paper) -> Iterator[Row]:
    """Springs and displacements of the mass-spring chain (section 2.1 and appendix A)."""
    scene = paper.scene("three_harmonics")
    count, spacing = scene.particle_count, scene.spacing
    mass, modulus = scene.density0()[0] * spacing, scene.modulus()[0]
    right, printed = (
        float(np.pi / np.sqrt(stiffness / mass) / np.sin(np.pi / count))
        for stiffness in (modulus / spacing, modulus * spacing)
    )
    yield Row(
        "springs of the chain k ≈ c a N/L",
        scene.name,
        "longest period of the chain [s]",
        float(np.sqrt(10)),
        right,
        printed,
        "k ≈ c a L/N, as printed",
        6,
    )
    scene = paper.scene("two_moduli")
    between = scene.positions + scene.spacing / 2
    stiffness = scene.youngs_modulus(x=between) / scene.spacing
    # Positions differ by Δx from one point to the next, and a mass is ρ0 Δx.
    rest = (stiffness - np.roll(stiffness, 1)) / scene.density0()
    yield Row(
        "y_n is displacement",
        scene.name,
        "largest acceleration of the chain at rest [m/s²]",
        0,
        0.0,
        float(np.abs(rest).max()),
        "position, as printed",
        7,
    )


def kernel_support(paper: Paper) -> Iterator[Row]:
    """Length of the kernel's support."""
    yield Row(
        "support of the kernel of length 4h",
        None,
        "h W_h(1.5 h)",
        None,
        float(kernel.kernel(1.5, 1.0)),
        0.0,
        "of length 2h, as printed",
        8,
    )


STUDIES = (
    time_stepping, smoothing_ratio, larger_smoothing_ratio, modulus, wavenumber, exact_reference,
    reference_resolution, density_shift, rounded_beta, error_norm, snapshots, mode_numbers, chain,
    kernel_support,
)  # fmt: skip


# Other time steppings -----------------------------------------------------------------------------


def solve_otherwise(scene: Scene, stepping: int) -> dict[str, np.ndarray]:
    """Full SPH without force by another time stepping, at the times of the error integral.

    Parameters
    ----------
    stepping : int
        EULER (the paper's), or another time stepping.

    Returns
    -------
    dict
        velocity (times, N) [m/s], density (times, N) [kg/m³].
    """
    steps, density0 = scene.error_steps, scene.density0()
    damping = scene.damping_values()
    velocity = np.empty((steps.size, scene.particle_count))
    density = np.empty_like(velocity)
    damping = damping if damping.size else np.zeros_like(density0)
    march(
        (scene.velocity0(), density0.copy()),
        (density0, scene.modulus(), damping),
        kernel.stencil_weights(scene.spacing, scene.smoothing_ratio),
        (scene.time_step, stepping, steps),
        (velocity, density),
    )
    return {"velocity": velocity, "density": density}


@compiled
def differentiate(field, weights, rate):
    """SPH derivative of a periodic field."""
    count, width = field.size, weights.size
    for i in range(count):
        total = 0.0
        if width <= i < count - width:
            for k in range(width):
                total += weights[k] * (field[i + k + 1] - field[i - k - 1])
        else:
            for k in range(width):
                right, left = (i + k + 1) % count, (i - k - 1) % count
                total += weights[k] * (field[right] - field[left])
        rate[i] = total


@compiled
def accelerate(v, rho, material, weights, stress, rate):
    """Rate of velocity."""
    density0, modulus, damping = material
    for i in range(v.size):
        stress[i] = modulus[i] * (1.0 - density0[i] / rho[i])
    differentiate(stress, weights, rate)
    for i in range(v.size):
        rate[i] = -rate[i] / density0[i] - damping[i] * v[i]


@compiled
def stretch(v, rho, density0, weights, rate):
    """Rate of density."""
    differentiate(v, weights, rate)
    for i in range(v.size):
        rate[i] *= -rho[i] * rho[i] / density0[i]


@compiled
def advance(field, dt, rate):
    """field += dt rate."""
    for i in range(field.size):
        field[i] += dt * rate[i]


@compiled
def march(state, material, weights, schedule, kept):
    """Keep the state after the given numbers of steps of a time stepping."""
    v, rho = state
    density0, _, damping = material
    dt, stepping, steps = schedule
    velocity, density = kept
    stress, dv, drho, old_v, old_rho = np.empty((5, v.size))
    done = 0
    for row in range(steps.size):
        for _ in range(done, steps[row]):
            for i in range(v.size):
                old_v[i] = v[i]
                old_rho[i] = rho[i]
            if stepping == DENSITY_FIRST:
                stretch(v, rho, density0, weights, drho)
                advance(rho, dt, drho)
            accelerate(v, rho, material, weights, stress, dv)
            advance(v, dt, dv)
            if stepping == VELOCITY_FIRST:
                stretch(v, rho, density0, weights, drho)
            elif stepping == LINEAR_DENSITY:
                stretch(old_v, density0, density0, weights, drho)
            elif stepping != DENSITY_FIRST:
                stretch(old_v, rho, density0, weights, drho)
            if stepping != DENSITY_FIRST:
                advance(rho, dt, drho)
            if stepping == IMPLICIT_DAMPING:
                for i in range(v.size):
                    v[i] = (v[i] + dt * damping[i] * old_v[i]) / (1.0 + dt * damping[i])
            if stepping == HEUN:
                accelerate(v, rho, material, weights, stress, dv)
                stretch(v, rho, density0, weights, drho)
                for i in range(v.size):
                    v[i] = (old_v[i] + v[i] + dt * dv[i]) / 2
                    rho[i] = (old_rho[i] + rho[i] + dt * drho[i]) / 2
        done = steps[row]
        for i in range(v.size):
            velocity[row, i] = v[i]
            density[row, i] = rho[i]
    return 0
