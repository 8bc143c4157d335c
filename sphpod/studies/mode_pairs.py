"""Errors of the original reduced model over both mode counts, that of velocity and of density."""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from sphpod.numerics.error import FIELDS, Arrays, project_solution
from sphpod.pipeline.dataset import meanings
from sphpod.reduced.pod import resolved
from sphpod.reduced.rom import ReducedModel, prepare_each
from sphpod.scene.scene import Scene
from sphpod.studies.study import WITHOUT_FREE_ENDS, Dataset, Drawing, Setting, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def measure(
    scene: Scene, largest: int, modes: Arrays, sph: Arrays, errors: Arrays
) -> dict[str, np.ndarray]:
    """POD error over SPH error of the original model for every pair of mode counts.

    Parameters
    ----------
    largest : int
        Largest number of modes of either field, or all there are.
    modes : dict
        velocity_modes, density_modes (one a row); velocity_span_rounding,
        density_span_rounding.
    sph : dict
        velocity, density (times, N).
    errors : dict
        velocity_error, density_error (solution, reference); those of full SPH against the first
        reference are the first.

    Returns
    -------
    dict
        As `STUDY` describes it; ratios are infinite where the model broke down.
    """
    rows = [modes[f"{field}_modes"][:largest] for field in FIELDS]
    projected = project_solution(sph, modes, largest)
    scales = [float(errors[f"{field}_error"][0, 0]) or np.nan for field in FIELDS]
    ratios = np.full((2, len(rows[0]), len(rows[1])), np.inf)
    for kv in range(1, len(rows[0]) + 1):
        models = [
            ReducedModel(scene, "original", rows[0][:kv], rows[1][:kr])
            for kr in range(1, len(rows[1]) + 1)
        ]
        for column, run in enumerate(prepare_each(models, scene.error_steps)):
            if run.run().breakdown() is None:
                ratios[:, kv - 1, column] = [
                    projected[field].relative_error(coordinates) / scale
                    for field, coordinates, scale in zip(FIELDS, run.state, scales, strict=True)
                ]
    kept = [np.arange(1, len(shapes) + 1) for shapes in rows]
    velocity, density = (
        resolved(counts, modes[f"{field}_span_rounding"])
        for field, counts in zip(FIELDS, kept, strict=True)
    )
    return {
        "velocity_modes_kept": kept[0],
        "density_modes_kept": kept[1],
        "pair_resolved": np.logical_and.outer(velocity, density),
    } | {f"pair_{field}_ratio": ratios[n] for n, field in enumerate(FIELDS)}


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """Rows of a table: for each number of velocity modes the fewest density modes that do."""
    works = (arrays["pair_velocity_ratio"] < 1) & (arrays["pair_density_ratio"] < 1)
    for kv, enough in zip(arrays["velocity_modes_kept"], works, strict=True):
        fewest = int(arrays["density_modes_kept"][enough][0]) if enough.any() else None
        yield {**place, "velocity_modes": int(kv), "fewest_density_modes": fewest}


def draw(pairs: Arrays) -> "Figure":
    """Draw the larger of both ratios over both mode counts, velocity up and density to the right.

    Parameters
    ----------
    pairs : dict
        As from `measure`.
    """
    import matplotlib.style
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    from sphpod.figures.plotting import BLACK, COLUMN_WIDTH, DIM, GREY, STYLE, UNRESOLVED_LABEL

    ratio = np.maximum(pairs["pair_velocity_ratio"], pairs["pair_density_ratio"])
    with matplotlib.style.context(["default", STYLE]):
        figure = Figure(figsize=(COLUMN_WIDTH, 2.6), layout="constrained")
        axes = figure.subplots()
        axes.set_facecolor(GREY)
        sizes = ratio[np.isfinite(ratio) & (ratio > 0)]
        span = min(max(1.01, sizes.max(initial=1), 1 / sizes.min(initial=1)), 1e4)
        norm = LogNorm(1 / span, span)
        edges = [
            np.arange(pairs[f"{field}_modes_kept"].size + 1) + 0.5
            for field in ("density", "velocity")
        ]
        shown = np.ma.masked_invalid(np.maximum(ratio, 1 / span))
        mesh = axes.pcolormesh(*edges, shown, norm=norm, cmap="RdBu_r", rasterized=True)
        # The pattern is fixed to the page, so that neighbouring pairs have one.
        noise = np.ma.masked_where(pairs["pair_resolved"].astype(bool), np.zeros(ratio.shape))
        if noise.count():
            axes.pcolor(*edges, noise, facecolor="none", edgecolor=DIM, hatch="//////", linewidth=0)
        for row, column in np.argwhere(ratio < 1):
            dot = edges[0][column] + 0.5, edges[1][row] + 0.5
            axes.plot(*dot, "ow", markersize=2, markeredgecolor=BLACK, markeredgewidth=0.4)
        axes.set(xlabel="density modes kρ", ylabel="velocity modes kv")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(6, integer=True, steps=(1, 2, 5, 10)))
        label = "POD error / SPH error"
        _scale(figure.colorbar(mesh, ax=axes, label=label, extend=_cut(sizes, span)), span)
        notes = "" if np.isfinite(ratio).all() else "; grey: broken down"
        notes += f"\nhatched: {UNRESOLVED_LABEL}" if noise.count() else ""
        axes.set_title(f"larger of v and ρ; dots: below 1{notes}", loc="left")
    return figure


def _cut(sizes, span):
    """At which ends of the colours ratios are cut."""
    cut = sizes.size > 0 and sizes.min() < 1 / span, sizes.size > 0 and sizes.max() > span
    return {(True, False): "min", (False, True): "max", (True, True): "both"}.get(cut, "neither")


def _scale(bar, span):
    """Ticks at powers of ten to both sides of one, at most three, or at the ends without any."""
    from sphpod.figures.plotting import shortened

    bar.outline.set_linewidth(0.6)
    step = int(np.ceil(np.log10(span) / 3))
    number = int(np.log10(span) / step)
    powers = 10.0 ** (step * np.arange(-number, number + 1))
    ticks = powers.tolist() if number else [1 / span, 1.0, span]
    bar.set_ticks(ticks, labels=[shortened(tick) for tick in ticks])
    bar.minorticks_off()


def places(config: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The samplings that are asked for."""
    asked = config["studies"]["mode_pairs"]["samplings"]
    return [(scene, sampling) for scene, names in asked.items() for sampling in names]


STUDY = Study(
    datasets={
        "mode_pairs": Dataset(
            compute="studies.mode_pairs.measure",
            message="{scene}: errors over both mode counts, snapshots {sampling}",
            of_sampling=True,
            reads={"modes": "pod.nc", "sph": "../sph.nc", "errors": "../errors.nc"},
            arguments={"largest": "studies.mode_pairs.largest"},
            needs=WITHOUT_FREE_ENDS,
            places=places,
        )
    },
    tables={"mode_pairs": ("studies.mode_pairs.rows", "mode_pairs")},
    drawing=Drawing(
        draw="studies.mode_pairs.draw",
        caption="Errors over both mode counts, original model: {scene}, snapshots {sampling}.",
        reads={"pairs": ("mode_pairs",)},
        places=places,
    ),
    settings={
        "samplings": Setting(
            dict[str, list[str]], {}, description="samplings of scenes, by name of the scene"
        ),
        "largest": Setting(int, 12, ge=1, le=100, description="largest mode count of either field"),
    },
    variables=meanings(
        """
        pair_resolved (velocity_modes_kept, density_modes_kept) [1] int8: 1 where rounding leaves
            the modes as they are
        velocity_modes_kept (velocity_modes_kept) [1] int32: velocity modes
        density_modes_kept (density_modes_kept) [1] int32: density modes
        pair_velocity_ratio (velocity_modes_kept, density_modes_kept) [1]: POD over SPH error in
            velocity
        pair_density_ratio (velocity_modes_kept, density_modes_kept) [1]: POD over SPH error in
            density
        """
    ),
)
