"""Observed order of convergence of every integrator, full model and reference.

Each is refined by halves, and of two errors the ratio shows the order p = log2(e(h)/e(h/2)). In
time the particles stay, and errors are those against the lifted full model exact in time, to which
any integrator of the same particles tends. In space the models are exact in time, and references
take as many steps more as nodes; errors are those against the exact solution, where it is known,
and against the next finer grid, which show whether there is a limit, and whether it is the right
one: SPH of a fixed ratio of smoothing length and spacing tends to the equations with waves that are
faster by β (appendix B), which the modified solution solves.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics.error import FIELDS, Arrays, relative_error
from sphpod.pipeline.dataset import meanings
from sphpod.reference import exact, reference
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.scene import Scene
from sphpod.scene.waves import fastest_wave
from sphpod.studies.study import EVEN, Dataset, Drawing, Setting, Study, scenes
from sphpod.studies.time_steps import run_pair

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PART = 10
"""Part of the duration, and of its steps, over which solutions are compared."""

OUTPUTS = 10
"""Times at which they are, at most."""

FEWEST = 20
"""Particles of the coarsest grid, at least."""

ROUNDING = 1e-12
"""Relative error that may be rounding, of which no order is given."""

ANGLES = {"symplectic_euler": 1.0, "leapfrog": 1.0, "rk45": 0.5, "dop853": 4.0}
"""Angle by which the fastest wave turns in the longest step of each integrator [rad]."""

WORDS = {
    "sph": "full SPH",
    "explicit_euler": "explicit Euler",
    "symplectic_euler": "symplectic Euler",
    "rk45": "RK45",
    "dop853": "DOP853",
    "lifted_full": "lifted full model",
    "reference_fd": "reference fd",
    "reference_centred": "reference centred",
}
"""Models and integrators in figures."""


def study(scene: Scene, levels: int) -> dict[str, np.ndarray]:
    """Errors and observed orders under refinement in time and in space.

    Parameters
    ----------
    scene : Scene
        Of evenly spaced particles.
    levels : int
        Grids or time steps, each half of the one before, at least three.

    Returns
    -------
    dict
        As `STUDY` describes it. A step or spacing is NaN where it stays or the model is exact in
        time, an error where a solution broke down, an order where an error may be rounding.
    """
    scene = _shortened(scene)
    found = [*_in_time(scene, levels), *_in_space(scene, levels)]
    names = ("refined_model", "refined_integrator", "refinement", "refined_against")
    arrays = {name: np.array([row[0][n] for row in found]) for n, name in enumerate(names)}
    sizes = np.array([row[1] for row in found]).transpose(1, 0, 2)
    arrays |= dict(zip(("refined_time_step", "refined_spacing"), sizes, strict=True))
    for n, field in enumerate(FIELDS):
        errors = np.array([row[2][n] for row in found])
        arrays[f"refined_{field}_error"] = errors
        arrays[f"refined_{field}_order"] = orders(errors)
    return arrays


def orders(errors: np.ndarray) -> np.ndarray:
    """Observed orders of errors (…, levels), shape (…, levels - 1); NaN of what may be rounding."""
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.log2(errors[..., :-1] / errors[..., 1:])
    return np.where(errors[..., 1:] > ROUNDING, found, np.nan)


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """A row for each refined model and level, with the order from the level before."""
    for n, model in enumerate(arrays["refined_model"]):
        for level, time_step in enumerate(arrays["refined_time_step"][n]):
            row = {
                "scene": place["scene"],
                "model": str(model),
                "integrator": str(arrays["refined_integrator"][n]),
                "refinement": str(arrays["refinement"][n]),
                "against": str(arrays["refined_against"][n]),
                "time_step": float(time_step),
                "spacing": float(arrays["refined_spacing"][n, level]),
            }
            for field in FIELDS:
                row[f"{field}_error"] = float(arrays[f"refined_{field}_error"][n, level])
                order = arrays[f"refined_{field}_order"][n, level - 1] if level else np.nan
                row[f"{field}_order"] = float(order)
            yield row


def _shortened(scene):
    """The scene over a part of its duration, with few outputs."""
    steps = max(1, scene.step_count // PART)
    outputs = min(OUTPUTS, steps)
    stride = steps // outputs
    return replace(
        scene,
        duration=float(scene.times(np.array([stride * outputs]))[0]),
        error_interval=float(scene.times(np.array([stride]))[0]),
    )


def _in_time(scene, levels):
    """Label, sizes and errors of each integrator, with the particles of the scene."""
    right = _fields(scene, lambda: lifted.solve(scene, "exact"))
    nothing = [np.nan] * levels
    for model, integrator, run in _integrators(scene):
        steps = _first_step(scene, integrator) / 2.0 ** np.arange(levels)
        errors = [_errors(_fields(scene, partial(run, step)), right) for step in steps]
        label = model, integrator, "time", "lifted_full exact"
        yield label, (steps, nothing), np.transpose(errors)


def _integrators(scene) -> Iterator[tuple[str, str, Callable[[float], Arrays]]]:
    def full_sph(step):
        case = replace(scene, time_step=step)
        return sph.solve(case, case.error_steps)

    yield "sph", "explicit_euler", full_sph
    for integrator in lifted.FIXED_STEP:
        yield "lifted_full", integrator, partial(lifted.solve, scene, integrator)
    for integrator in lifted.ADAPTIVE:
        yield "lifted_full", integrator, partial(_pair, scene, integrator)


def _pair(scene, integrator, step):
    begin = np.concatenate([scene.velocity0(), np.zeros(scene.particle_count)])
    stride = round(scene.error_interval / step)
    states = run_pair(scene, integrator, begin, step, stride, scene.error_times.size - 1)
    velocity, strain = np.split(states, 2, axis=1)
    return {"velocity": velocity, "strain": strain}


def _first_step(scene, integrator):
    """The longest step of an integrator, which divides the interval of outputs."""
    if integrator == "explicit_euler":
        return scene.time_step
    longest = ANGLES[integrator] / fastest_wave(scene)
    return scene.error_interval / np.ceil(scene.error_interval / longest)


def _in_space(scene, levels):
    """Label, sizes and errors of the full model and the numerical references."""
    coarsest = scene.particle_count // 2 ** (levels - 1)
    if coarsest < FEWEST or scene.particle_count % 2 ** (levels - 1):
        coarsest = scene.particle_count
    factors = 2 ** np.arange(levels)
    cases = [
        replace(
            scene,
            particle_count=int(coarsest * factor),
            time_step=scene.time_step * scene.particle_count / (coarsest * factor),
        )
        for factor in factors
    ]
    # A coarser grid takes longer steps, of which an interval must hold a whole number.
    cases = [replace(case, time_step=_dividing(case)) for case in cases]
    spacings = [case.spacing for case in cases]
    kind = exact.kind(scene)
    for model, integrator, solve in (
        ("lifted_full", "exact", lambda case: lifted.solve(case, "exact")),
        ("reference_fd", "midpoint", reference.solve_paper),
        ("reference_centred", "midpoint", lambda case: reference.solve_centred(case, False)),
    ):
        steps = [np.nan if integrator == "exact" else case.time_step for case in cases]
        found = [
            _fields(case, partial(solve, case), factor)
            for case, factor in zip(cases, factors, strict=True)
        ]
        label = model, integrator, "space"
        finer = [_errors(one, other) for one, other in pairwise(found)]
        finer.append((np.nan, np.nan))
        yield (*label, "next finer grid"), (steps, spacings), np.transpose(finer)
        for against, known, solver in (
            ("exact", kind, exact.solve),
            ("modified", kind == "dalembert" and integrator == "exact", exact.solve_modified),
        ):
            if known:
                right = _fields(cases[0], partial(solver, cases[0]))
                errors = np.transpose([_errors(one, right) for one in found])
                yield (*label, against), (steps, spacings), errors


def _dividing(scene):
    """The longest time step up to the scene's that divides its interval of outputs."""
    return scene.error_interval / np.ceil(scene.error_interval / scene.time_step * (1 - 1e-9))


def _fields(scene, solve, every=1):
    """Velocity and density at every so many particles; None of a solution that breaks down."""
    try:
        found = solve()
    except Breakdown:
        return None
    if "density" not in found:
        found = {"velocity": found["velocity"], "density": lifted.density(scene, found["strain"])}
    return {field: found[field][:, ::every] for field in FIELDS}


def _errors(found, right):
    if found is None or right is None:
        return [np.nan] * len(FIELDS)
    return [relative_error(found[field], right[field]) for field in FIELDS]


def draw(tables: Mapping[tuple[str, ...], Arrays]) -> "Figure":
    """Draw observed orders, of the two finest levels whose errors are known, a marker a scene.

    Parameters
    ----------
    tables
        By scene, as from `study`.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import MultipleLocator

    from sphpod.figures import plotting, stability_plots

    @plotting.styled
    def drawn():
        looks = stability_plots.scene_looks(tables)
        labels = list(dict.fromkeys(one for arrays in tables.values() for one in _known(arrays)))
        height = 1.4 + 0.25 * len(labels)
        figure = Figure(figsize=(plotting.COLUMN_WIDTH, height), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for axes, field in zip(panels, FIELDS, strict=True):
            for number, ((scene, *_), arrays) in enumerate(tables.items()):
                shift = 0.7 * ((number + 0.5) / len(tables) - 0.5)
                orders = dict(zip(_labels(arrays), arrays[f"refined_{field}_order"], strict=True))
                heights = [n + shift for n, label in enumerate(labels) if label in orders]
                found = [_finest(orders[label]) for label in labels if label in orders]
                look = {**looks[scene], "linestyle": "", "label": scene.replace("_", " ")}
                axes.plot(found, heights, **look)
            axes.set_title(field)
            axes.set_xlabel("observed order")
            axes.xaxis.set_major_locator(MultipleLocator(2))
            axes.xaxis.set_minor_locator(MultipleLocator(1))
            axes.grid(axis="x", which="both", color=plotting.PALE)
            for place in range(1, len(labels)):
                axes.axhline(place - 0.5, color=plotting.PALE, linewidth=0.5)
        named = [label.replace(", ", ",\n") for label in labels]
        panels[0].set_yticks(range(len(labels)), named)
        panels[0].set_ylim(len(labels) - 0.5, -0.5)
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
        return figure

    return drawn()


def _labels(arrays) -> Iterable[str]:
    """What is refined and how, in words."""
    names = ("refined_model", "refined_integrator", "refinement", "refined_against")
    for model, integrator, refinement, against in zip(*(arrays[n] for n in names), strict=True):
        what = integrator if refinement == "time" and model != "sph" else model
        how = "in time" if refinement == "time" else f"against {against}"
        yield f"{WORDS.get(what, what)}, {how}"


def _known(arrays) -> Iterable[str]:
    """Those of which an order is known."""
    orders = np.stack([arrays[f"refined_{field}_order"] for field in FIELDS])
    known = ~np.isnan(orders).all(axis=(0, 2))
    return (label for label, one in zip(_labels(arrays), known, strict=True) if one)


def _finest(values):
    known = values[~np.isnan(values)]
    return known[-1] if known.size else np.nan


STUDY = Study(
    datasets={
        "observed_order": Dataset(
            compute="studies.observed_order.study",
            message="{scene}: observed orders of convergence",
            arguments={"levels": "studies.observed_order.levels"},
            needs=EVEN,
            places=lambda config: scenes(config, EVEN),
        )
    },
    tables={"observed_order": ("studies.observed_order.rows", "observed_order")},
    drawing=Drawing(
        draw="studies.observed_order.draw",
        caption="Observed order of convergence of integrators, full models and references.",
        reads={"tables": ("observed_order",)},
    ),
    settings={
        "levels": Setting(
            int, 3, ge=3, le=8, description="grids and time steps, each half of the one before"
        )
    },
    variables=meanings(
        """
        refined_model (refined): model that is refined
        refined_integrator (refined): how it is stepped
        refinement (refined): what is refined, time or space
        refined_against (refined): what its errors are taken against
        refined_time_step (refined, level) [s]: time step of each level
        refined_spacing (refined, level) [m]: particle spacing of each level
        refined_velocity_error (refined, level) [1]: relative L2 error of the velocity
        refined_density_error (refined, level) [1]: relative L2 error of the mass density
        refined_velocity_order (refined, halving) [1]: observed order of the velocity's error
        refined_density_order (refined, halving) [1]: observed order of the mass density's error
        """
    ),
)
