"""The public functions, for a notebook or a script of one's own.

Results are an `xarray.Dataset` with names, units and meanings as in the files of the workflow
(docs/notation.md); ``dataset["velocity"].values`` is the array. What is asked for as a dataset may
be any mapping of arrays by these names.

Solutions are kept at the times of the error integral, ``scene.error_times``, shape (times,); N is
the number of particles.
"""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sphpod.bar import of_bar
from sphpod.config import config
from sphpod.full import lifted, sph
from sphpod.labelled import Data, arrays_of, labelled
from sphpod.numerics import error
from sphpod.reduced import certificate, error_bound, lifted_rom, pod, rom, rounding, snapshots
from sphpod.reference import chain, exact, reference
from sphpod.scene import resolution, waves
from sphpod.scene.scene import Scene

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

REFERENCES = {
    "fd": reference.solve_paper,
    "centred": reference.solve_centred,
    "chain": chain.solve,
    "exact": exact.solve,
    "modified": exact.solve_modified,
}
"""How each kind of reference is solved."""


# --- Full solutions -------------------------------------------------------------------------------


def solve_sph(scene: Scene) -> "xarray.Dataset":
    """Full SPH with explicit Euler steps, (2.10) and (2.11).

    Parameters
    ----------
    scene : Scene

    Returns
    -------
    xarray.Dataset
        velocity (t, x) [m/s], density (t, x) [kg/m³]; as attributes what is predicted of waves that
        grow or are not resolved (`waves.predict`, `resolution.predict`), which the log warns
        of.

    Raises
    ------
    Breakdown
        The solution became non-finite or its density stopped being positive.
    """
    predicted = waves.predict(scene) | resolution.predict(scene)
    return labelled(scene, sph.solve(scene, scene.error_steps), predicted)


def solve_lifted(
    scene: Scene, integrator: str = "exact", time_step: float | None = None, tolerance: float = 1e-8
) -> "xarray.Dataset":
    """Full SPH in velocity and strain e = ρ0/ρ - 1, in which it is linear (`sphpod.full.lifted`).

    Parameters
    ----------
    scene : Scene
    integrator : {"exact", "explicit_euler", "symplectic_euler", "leapfrog", "rk45", "dop853"}
    time_step : float, optional
        Fixed step [s] of explicit_euler, symplectic_euler and leapfrog; the scene's if not given.
    tolerance : float
        Relative tolerance of rk45 and dop853.

    Returns
    -------
    xarray.Dataset
        velocity (t, x) [m/s], density (t, x) [kg/m³], strain (t, x).

    Raises
    ------
    ValueError
        There is no such integrator, or the error interval is no multiple of the time step.
    Breakdown
        The solution became non-finite or its Jacobian 1 + e stopped being positive.
    """
    solution = lifted.solve(scene, integrator, time_step, tolerance)
    return labelled(scene, solution | {"density": lifted.density(scene, solution["strain"])})


def solve_reference(scene: Scene, kind: str) -> "xarray.Dataset":
    """A solution by other means than SPH, to compare with (section 3, appendix C.2).

    Parameters
    ----------
    scene : Scene
    kind : {"fd", "centred", "chain", "exact", "modified"}
        The paper's finite differences; centred ones, with an estimate of their error; an exact
        solution; or that of the equations that SPH is consistent with.

    Returns
    -------
    xarray.Dataset
        velocity (t, x) [m/s], density (t, x) [kg/m³]; for centred differences also what
        `reference.solve_centred` says of their error.

    Raises
    ------
    ValueError
        There is no such kind, or no such solution of this scene is known.
    Breakdown
        The solution became non-finite, or the line folds over itself.
    """
    if kind not in REFERENCES:
        allowed = ", ".join(REFERENCES)
        raise ValueError(f"scene {scene.name}: reference = {kind}: allowed are {allowed}")
    return labelled(scene, REFERENCES[kind](scene))


# --- Reduced models -------------------------------------------------------------------------------


def take_snapshots(scene: Scene, **sampling: Any) -> "xarray.Dataset":
    """Snapshots of velocity and density of full SPH (section 2.3).

    Parameters
    ----------
    scene : Scene
    **sampling
        range [s] and count: evenly spaced, the right end excluded, or with a seed distinct random
        time steps; or velocity_times and density_times [s].

    Returns
    -------
    xarray.Dataset
        velocity_snapshots (velocity_snapshot, x) [m/s] at velocity_time [s], density_snapshots
        (density_snapshot, x) [kg/m³] at density_time; and velocity_twins, density_twins, those of
        a run that is rounded differently.

    Raises
    ------
    ConfigError
        The sampling is not allowed; the message names it ``snapshots``.
    Breakdown
        Full SPH broke down before the last snapshot.
    """
    checked = config.check_sampling(scene, "snapshots", sampling)
    steps = np.unique(np.concatenate([[0], *snapshots.sampling_steps(scene, checked)]))
    taken = snapshots.extract(scene, checked, sph.solve(scene, steps))
    return labelled(scene, taken | rounding.twins(scene, checked))


def decompose(snapshots: Data, scene: Scene | None = None) -> "xarray.Dataset":
    """POD modes of velocity and of density snapshots, for the paper's models (section 2.3).

    Parameters
    ----------
    snapshots : dataset
        As from `take_snapshots`; the twins may be missing.
    scene : Scene, optional
        Needed of a bar with ends.

    Returns
    -------
    xarray.Dataset
        velocity_modes (velocity_mode, x) and density_modes, orthonormal, one a row;
        velocity_singular_values [m/s], density_singular_values [kg/m³]; and how far rounding turns
        modes and their spans (`pod.Modes`).

    Raises
    ------
    ValueError
        There is no snapshot, a value is not finite, or a density not positive; or the snapshots are
        of a bar with ends, and its scene is not given.
    """
    if scene is None and (ends := getattr(snapshots, "attrs", {}).get("boundary")):
        raise ValueError(f"snapshots of a bar with ends {ends}: its scene must be given, too")
    given = arrays_of(scene, "snapshots", snapshots, "velocity_snapshots", "density_snapshots")
    return labelled(scene, pod.decompose(given))


def decompose_lifted(scene: Scene, snapshots: Data) -> "xarray.Dataset":
    """Modes of the scaled fields √m v and √(V c) e, orthonormal in the energy (`lifted_rom`).

    Parameters
    ----------
    scene : Scene
    snapshots : dataset
        As from `take_snapshots`; the twins may be missing.

    Returns
    -------
    xarray.Dataset
        scaled_velocity_modes (scaled_velocity_mode, x), scaled_strain_modes, one a row, their
        singular values [√(J/m²)], how far rounding turns them, and translation, 1 if the first
        velocity mode is the rigid translation.

    Raises
    ------
    ValueError
        As `decompose`; or nothing moves in the snapshots of a scene that moves.
    """
    given = arrays_of(scene, "snapshots", snapshots, "velocity_snapshots")
    return labelled(scene, lifted_rom.decompose(scene, given))


def solve_reduced(scene: Scene, method: str, modes: Data, mode_count: int) -> "xarray.Dataset":
    """Run a reduced model, and give its coordinates and its fields at the particles.

    Parameters
    ----------
    scene : Scene
    method : str
        original, the projected equations (section 2.3); linearized, or frozen1, frozen2, … with
        coefficients that stand for so many steps (section 2.4), (2.21) to (2.24); lifted_euler,
        which repeats explicit Euler, or lifted_exact, exact in time (`lifted_rom`).
    modes : dataset
        From `decompose`; of a lifted model from `decompose_lifted`.
    mode_count : int
        Modes for each field; all there are, as the log warns, where the snapshots hold fewer.

    Returns
    -------
    xarray.Dataset
        velocity (t, x) [m/s], density (t, x) [kg/m³]; velocity_coordinates (t, velocity_mode),
        density_coordinates; of lifted models strain (t, x) and the coordinates of the scaled
        fields instead; of lifted_exact also error_bound (t) [√(J/m²)], a bound of the energy norm
        of the difference from the lifted full model (`error_bound.error_bounds`).

    Raises
    ------
    ValueError
        There is no such method, these are not its modes, or no mode is asked for.
    Breakdown
        The model is not finite, or its density or Jacobian not positive.
    """
    (count,) = _counts(scene, [mode_count])
    found = _modes(scene, method, modes)
    if method not in lifted_rom.METHODS:
        run = rom.model(scene, method, found, count).prepare(scene.error_steps).solve()
        arrays = run.fields() | run.stored()
    else:
        lifted_run = lifted_rom.build(scene, found, count).prepare(method).solve()
        arrays = lifted_run.fields() | lifted_run.stored()
        arrays["density"] = lifted.density(scene, arrays["strain"])
        if method == "lifted_exact":
            arrays["error_bound"], _ = error_bound.error_bounds(lifted_run)
    return labelled(scene, {"x": scene.positions} | arrays, {"method": method})


def sweep(
    scene: Scene, method: str, mode_counts: Iterable[int], modes: Data, full: Data, reference: Data
) -> "xarray.Dataset":
    """Errors of a reduced model for several mode counts (section 3.1).

    Parameters
    ----------
    scene : Scene
    method, modes
        As in `solve_reduced`.
    mode_counts : ints
    full : dataset
        The full model that the method reduces: of `solve_sph`; for lifted_exact of `solve_lifted`.
    reference : dataset
        Of `solve_reference`.

    Returns
    -------
    xarray.Dataset
        By mode_count: relative errors of velocity and density, as velocity_error_sph and
        velocity_error_reference; of lifted_exact also those against its full model, relative in
        the energy, and their bound energy_error_bound (`certificate.certify`); breakdown_time [s],
        NaN where the model held; and modes_resolved, 0 where rounding decides over the modes.
        Errors of what broke down are infinite. A single count adds coordinates over time.

    Raises
    ------
    ValueError
        As `solve_reduced`; or a solution is of other times or particles.
    Breakdown
        The model for a single mode count broke down.
    """
    counts, found = _counts(scene, mode_counts), _modes(scene, method, modes)
    seen = ("velocity", "strain") if method == "lifted_exact" else error.FIELDS
    full = arrays_of(scene, "full", full, *seen)
    reference = arrays_of(scene, "reference", reference, *error.FIELDS)
    if method == "lifted_exact":
        arrays = certificate.certify(scene, counts, found, full, reference)
    elif method == "lifted_euler":
        arrays = lifted_rom.repeat_sph(scene, counts, found, full, reference)
    else:
        arrays = rom.sweep(scene, method, counts, found, full, reference)
    return labelled(scene, arrays, {"method": method})


def _modes(scene, method, modes):
    """Arrays of the modes that a method takes."""
    if method not in lifted_rom.METHODS:
        try:
            rom.freeze_steps(method)
        except ValueError as refusal:
            raise ValueError(
                f"scene {scene.name}: {refusal}, {', '.join(lifted_rom.METHODS)}"
            ) from None
    scaled = method in lifted_rom.METHODS
    needed = ("scaled_velocity", "scaled_strain") if scaled else error.FIELDS
    return arrays_of(scene, f"modes of {method}", modes, *(f"{name}_modes" for name in needed))


def _counts(scene, mode_counts):
    counts = list(mode_counts)
    for count in counts:
        if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < 1:
            raise ValueError(
                f"scene {scene.name}: mode_count = {count}: it must be a whole number from 1 on"
            )
    if not counts:
        raise ValueError(f"scene {scene.name}: mode_counts: at least one is needed")
    return [int(count) for count in counts]


# --- Errors ---------------------------------------------------------------------------------------


def relative_error(solution: Any, reference: Any) -> float:
    """Relative L2 error over times and particles (3.4), with the square root it leaves out.

    Parameters
    ----------
    solution, reference : arrays, shape (times, N)
        One field of each, such as ``full["velocity"]``, at the same times and particles.

    Returns
    -------
    float
        Dimensionless; NaN where the reference is zero and the solution is not.

    Raises
    ------
    ValueError
        Their shapes differ.
    """
    solution, reference = (np.asarray(field, float) for field in (solution, reference))
    if solution.shape != reference.shape:
        raise ValueError(
            f"solution of shape {solution.shape}: it must have that of the reference, "
            f"{reference.shape}"
        )
    return error.relative_error(solution, reference)


def compare(scene: Scene, full: Data, references: Mapping[str, Data]) -> "xarray.Dataset":
    """Errors of full SPH against references, and of these against the exact solution (section 3.1).

    Parameters
    ----------
    scene : Scene
    full : dataset
        Of `solve_sph`.
    references : mapping
        Solutions of `solve_reference` by kind.

    Returns
    -------
    xarray.Dataset
        velocity_error and density_error (solution, reference); NaN where none is asked for.

    Raises
    ------
    ValueError
        A solution is of other times or particles.
    """
    solutions = {
        name: arrays_of(scene, name, data, *error.FIELDS)
        for name, data in {"sph": full, **references}.items()
    }
    sph, *others = solutions.values()
    return labelled(scene, error.table(sph, others, list(references)))


# --- Figures --------------------------------------------------------------------------------------


def plot_profile(
    scene: Scene, solution: Data, fields: Iterable[str] = ("initial_velocity", "velocity")
) -> "Figure":
    """Initial velocity and space-time pictures of a solution (figure 3.1).

    Parameters
    ----------
    scene : Scene
    solution : dataset
        Of any model or reference.
    fields : names
        A panel each: initial_velocity, velocity or density_change.

    Returns
    -------
    matplotlib.figure.Figure
        Its panels are ``figure.axes``.

    Raises
    ------
    ValueError
        A field is none of the three, or the solution is of other times or particles.
    """
    from sphpod.figures import plotting

    arrays = arrays_of(scene, "solution", solution, *error.FIELDS)
    return plotting.profile(of_bar(scene, arrays), list(fields), scene.bar_length)


def plot_modes(scene: Scene, modes: Data, count: int = 12) -> "Figure":
    """The first POD modes of velocity and density (figure 3.2); returns a Figure.

    Parameters
    ----------
    scene : Scene
    modes : dataset
        Of `decompose`.
    count : int

    Raises
    ------
    ValueError
        These are not such modes, or those of other particles.
    """
    from sphpod.figures import plotting

    arrays = arrays_of(scene, "modes", modes, "velocity_modes", "density_modes")
    return plotting.modes(of_bar(scene, arrays), count, scene.bar_length)


def plot_errors(modes: Data, sweep: Data, errors: Data, reference: str) -> "Figure":
    """Singular values, and errors against the number of modes (figure 3.3); returns a Figure.

    Parameters
    ----------
    modes, sweep, errors : datasets
        Of `decompose`, of `sweep` against full SPH, and of `compare`.
    reference : str
        The reference of the sweep, as `compare` names it.

    Raises
    ------
    ValueError
        The data are not these.
    """
    from sphpod.figures import plotting

    return plotting.error(
        arrays_of(None, "modes", modes, "velocity_singular_values", "density_singular_values"),
        arrays_of(None, "sweep", sweep, "velocity_error_sph", "velocity_error_reference"),
        arrays_of(None, "errors", errors, "velocity_error", "density_error"),
        reference,
    )
