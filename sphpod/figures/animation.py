"""Motion of full SPH and of reduced models beside it, as a picture that moves."""

import os

import matplotlib.style
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.figure import Figure

from sphpod.figures.plotting import BLUE, GREEN, GREY, STYLE, VERMILLION
from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import whole

FRAMES = 120
"""Pictures of one animation, and how many of them a second has."""
RATE = 20


def velocities(reduced: Arrays, rows: np.ndarray) -> np.ndarray:
    """Velocity (rows, N) [m/s] of a reduced model of a single mode count, at some of its times.

    Parameters
    ----------
    reduced : dict
        velocity_output (2k, N), and the coordinates that it takes: of velocity and density, or of
        scaled velocity and strain, (times, k).
    rows : int array
    """
    kinds = ("velocity", "density")
    if "velocity_coordinates" not in reduced:
        kinds = "scaled_velocity", "scaled_strain"
    state = np.concatenate([reduced[f"{kind}_coordinates"][rows] for kind in kinds], axis=1)
    return state @ reduced["velocity_output"]


def write(
    path: str | os.PathLike[str], sph: Arrays, original: Arrays, lifted: Arrays, seconds: float
) -> None:
    """Write an animation of the velocity: full SPH, and it under both reduced models, each in grey.

    Parameters
    ----------
    path : GIF file
    sph : dict
        t (times,) [s], x (N,) [m] and velocity (times, N) [m/s] of full SPH.
    original, lifted : dicts
        Reduced models of a single mode count, at the same times.
    seconds : float
        Time of the motion that is shown [s].
    """
    last = int(np.searchsorted(sph["t"], seconds, side="right")) - 1
    rows = np.linspace(0, last, FRAMES).round().astype(int)
    full = sph["velocity"][rows]
    shown = (
        ("full SPH", full, BLUE),
        ("original POD", velocities(original, rows), VERMILLION),
        ("lifted POD", velocities(lifted, rows), GREEN),
    )
    limit = 1.1 * np.abs(full).max() or 1.0
    with matplotlib.style.context(["default", STYLE]), whole(path) as partial:
        figure = Figure(figsize=(6.0, 1.9), layout="constrained")
        lines = []
        for axes, (name, _, colour) in zip(figure.subplots(1, 3, sharey=True), shown, strict=True):
            axes.set(xlim=(sph["x"][0], sph["x"][-1]), ylim=(-limit, limit), title=name)
            axes.set_xlabel("position x [m]")
            lines.append(axes.plot(sph["x"], full[0], color=GREY, linewidth=2)[0])
            lines.append(axes.plot(sph["x"], full[0], color=colour)[0])
        figure.axes[0].set_ylabel("velocity v [m/s]")
        clock = figure.axes[0].text(0.03, 0.93, "", transform=figure.axes[0].transAxes)

        def draw(frame: int) -> list[object]:
            for n, (_, values, _) in enumerate(shown):
                lines[2 * n].set_ydata(full[frame])
                lines[2 * n + 1].set_ydata(values[frame])
            clock.set_text(f"t = {sph['t'][rows[frame]]:.2f} s")
            return [*lines, clock]

        motion = FuncAnimation(figure, draw, frames=FRAMES)  # type: ignore[arg-type]
        motion.save(os.fspath(partial), writer=PillowWriter(fps=RATE), dpi=120)
