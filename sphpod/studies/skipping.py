"""What it saves to leave out what a scene does not need.

Each thing that a scene may lack is run twice, by the model that leaves it out and by the general
one that is given zeros, or the general structure, in its place. Both give the same result.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics.expressions import Expression
from sphpod.numerics.separation import Products
from sphpod.reduced import lifted_rom
from sphpod.reference import exact, reference
from sphpod.scene.scene import IN_X_AND_T, Scene
from sphpod.studies import timing
from sphpod.studies.scaling import PLAIN, waves
from sphpod.studies.study import Dataset, Study, step_scene

MODES = 12

SHORTEST = 0.02
"""Seconds that a timed run lasts at least."""

TURNS = 3
"""How many turns are taken for one repeat: what is skipped may be a small part of a run."""

Timed = Callable[[], Any]


class Pair(NamedTuple):
    """Something that a scene may lack, in a model: without it, and with it in vain."""

    skipped: str
    model: str
    without: Timed
    general: Timed


@dataclass(frozen=True)
class Undamped(Scene):
    """A scene whose damping is given, as zeros."""

    def damping_values(self, positions=None):
        return np.zeros_like(self.positions if positions is None else positions)


@dataclass(frozen=True)
class Varied(Scene):
    """A scene whose modulus is given for every particle, and differs by a rounding."""

    def modulus(self):
        values = super().modulus()
        values[0] = np.nextafter(values[0], np.inf)
        return values


def measure(scene: Scene, repeats: int) -> dict[str, np.ndarray]:
    """CPU time with and without each thing that a scene may lack.

    Parameters
    ----------
    scene : Scene
        Undamped and unforced, with uniform material, and an exact solution.
    repeats : int

    Returns
    -------
    dict
        skipped, skipping_model (things,); skipping_seconds without the thing and general_seconds
        with it in vain, (things, turns) [s].
    """
    pairs = _pairs(scene)
    runs = [run for pair in pairs for run in (pair.without, pair.general)]
    numbers = [timing.warm_up(run, SHORTEST) for run in runs]
    seconds = timing.measure(runs, TURNS * repeats, numbers)
    return {
        "skipped": np.array([pair.skipped for pair in pairs]),
        "skipping_model": np.array([pair.model for pair in pairs]),
        "skipping_seconds": seconds[::2],
        "general_seconds": seconds[1::2],
    }


def _pairs(scene: Scene) -> list[Pair]:
    settings = {name: getattr(scene, name) for name in scene.__dataclass_fields__}
    nothing = Products((Expression("0*t", ("t",), {}),), (None,))
    forced = replace(scene, forces=(nothing,))
    modulus = scene.youngs_modulus
    in_time = Expression(f"({modulus.text}) + 0*t", IN_X_AND_T, modulus.constants)
    stepped = replace(scene, youngs_modulus=in_time)
    undamped, varied = Undamped(**settings), Varied(**settings)
    last = np.array([0, scene.step_count])

    def full(case, steps=scene.error_steps):
        return sph.prepare(case, steps, "stencil").run

    def strained(case):
        return lifted.prepare(case, "explicit_euler").run

    rows = waves(scene.particle_count, MODES)

    def jumping(case):
        return lifted_rom.LiftedModel(case, rows, rows[1:], 1).prepare("lifted_exact").run

    coarse = replace(scene, particle_count=scene.particle_count // 4)

    def found(neighbours):
        return lambda: sph.prepare(scene, last, neighbours).run()

    plain = full(scene)
    return [
        Pair("force", "full SPH", plain, full(forced)),
        Pair("force", "lifted_exact, k = 12", jumping(scene), jumping(forced)),
        Pair("damping", "full SPH", plain, full(undamped)),
        Pair("varying modulus", "lifted full model", strained(scene), strained(varied)),
        Pair("modulus in time", "full SPH", plain, full(stepped)),
        Pair("modulus in time", "lifted full model", strained(scene), strained(stepped)),
        Pair("nonlinearity", "full SPH", strained(scene), plain),
        Pair("neighbour search", "full SPH", found("stencil"), found("lists")),
        Pair("outputs nobody asked for", "full SPH", full(scene, last), plain),
        Pair(
            "numerical reference",
            "reference solution, N/4",
            lambda: exact.solve(coarse),
            lambda: reference.solve_centred(coarse, estimate_error=True),
        ),
    ]


def rows(
    place: Mapping[str, str], measured: Mapping[str, np.ndarray], settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Median times without and with what a scene may lack, their spread, and the median ratio.

    The ratio is taken turn by turn, so that it does not drift with the machine's speed.
    """
    columns: dict[str, Any] = {
        "scene": place["scene"],
        "particle_count": settings["particle_count"],
        "skipped": measured["skipped"],
        "model": measured["skipping_model"],
    }
    for name in ("skipping_seconds", "general_seconds"):
        lower, median, upper = np.quantile(measured[name], (0.25, 0.5, 0.75), axis=1)
        columns |= {name: median, f"{name}_interquartile_range": upper - lower}
    ratio = measured["general_seconds"] / measured["skipping_seconds"]
    return columns | {
        "general_over_skipping": np.median(ratio, axis=1),
        "machine": settings["machine"]["processor"],
    }


STUDY = Study(
    target="benchmarks",
    datasets={
        "skipping": Dataset(
            compute="studies.skipping.measure",
            message="{scene}: what it saves to leave out what is not needed",
            arguments={"repeats": "benchmark.repeats"},
            needs=PLAIN,
            alone=True,
            places=step_scene,
        )
    },
    tables={"skipping": ("studies.skipping.rows", "skipping")},
)
