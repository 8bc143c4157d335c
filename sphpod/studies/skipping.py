"""What it saves to leave out what a scene does not need.

Each thing that a scene may lack is run twice, by the model that leaves it out and by the general
one that is given zeros, or the general structure, in its place. Both give the same result.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from sphpod.full import lifted, sph
from sphpod.numerics import timing
from sphpod.numerics.error import Arrays
from sphpod.numerics.expressions import Expression
from sphpod.numerics.separation import Products
from sphpod.reduced import lifted_rom
from sphpod.reference import exact, reference
from sphpod.scene.ends import VELOCITY, Ends, Mirrored
from sphpod.scene.scene import IN_X_AND_T, Scene
from sphpod.studies.scaling import PLAIN, waves
from sphpod.studies.study import Dataset, Study, step_scene
from sphpod.surveys import training
from sphpod.surveys.parts import Operators
from sphpod.surveys.query import Survey

MODES = 12

OUTPUTS = 100
"""Intervals between the outputs of a training run."""

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

    Returns
    -------
    dict
        skipped, skipping_model (things,); skipping_seconds without the thing and general_seconds
        with it in vain, (things, turns) [s].
    """
    pairs = _pairs(scene)
    runs = [run for pair in pairs for run in (pair.without, pair.general)]
    numbers = [timing.warm_up(run) for run in runs]
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
    free = Ends("free", "free", scene.domain_length / 2)
    even = Mirrored(scene.initial_velocity, free, scene.spacing, VELOCITY)
    ended = replace(scene, ends=free, initial_velocity=even)
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
        Pair("ends", "full SPH", full(replace(ended, ends=None)), full(ended)),
        *_of_surveys(scene, plain),
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


def _of_surveys(scene: Scene, plain: Callable[[], object]) -> list[Pair]:
    """What of a survey a run at nominal values, and a parameter that scales a force, do without."""
    rows = waves(scene.particle_count, MODES)
    shared = {"velocity_modes": rows, "translation": 1}
    settings = {
        "domain_length": scene.domain_length,
        "duration": scene.duration,
        "initial_velocity": scene.initial_velocity.text,
        "initial_density": scene.initial_density.text,
        "youngs_modulus": scene.youngs_modulus.text,
        "particle_count": scene.particle_count,
        "smoothing_ratio": scene.smoothing_ratio,
        "time_step": scene.time_step,
        "error_interval": scene.duration / OUTPUTS,
        "parameters": {"size": {"nominal": 1e-3, "range": [0, 1e-2], "scale": "linear"}},
    }
    survey = {"training": {"count": 1}, "mode_count": MODES, "tolerance": 1e-2}

    def query(profile):
        force = {"time": "size*cos(4*t)", "profile": profile}
        of_survey = Survey(Operators(scene.name, settings | {"force": force}, shared), MODES)
        return lambda: of_survey.model({"size": 2e-3})

    def with_survey():
        run = training.run(scene.name, settings, survey, 0)
        training.train(scene.name, settings, survey, [run])
        return plain()

    return [
        Pair("a survey", "full SPH at nominal values", plain, with_survey),
        Pair(
            "operators of a force that is scaled",
            "query of a survey, k = 12",
            query("sin(2*pi*x/L)"),
            query("sin(2*pi*x/L)*exp(0*size*x)"),
        ),
    ]


def rows(place: Mapping[str, str], measured: Arrays, settings: Mapping[str, Any]) -> dict[str, Any]:
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
