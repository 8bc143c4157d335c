"""The paper's own study: what it needs of a configuration, and what the paper prints on it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from sphpod.numerics.error import Arrays
from sphpod.scene.scene import Scene

FIELDS = {"velocity": "v", "density": "ρ"}

NEEDED = {
    "three_harmonics": ("uniform100", "minimal"),
    "ten_harmonics": ("uniform15", *(f"half_period_{n}" for n in range(15, 21))),
    "damped": (),
    "damped_forced": (),
    "two_moduli": (),
    "gaussian_coarse": (),
    "gaussian": (),
    "high_frequency": (),
}
"""Scenes of the studies, and their samplings."""


def applies(config: Mapping[str, Any]) -> bool:
    """Whether a configuration has the scenes, references and samplings of the paper."""
    scenes = config["scenes"]
    return all(
        name in scenes
        and set(samplings) <= set(scenes[name]["samplings"])
        and set(_references(name)) <= set(scenes[name]["references"])
        for name, samplings in NEEDED.items()
    )


def inputs(config: Mapping[str, Any]) -> list[str]:
    """Paths below the results that the studies read."""
    known = (name for name, scene in config["scenes"].items() if "exact" in scene["references"])
    paths = [f"{name}/errors.nc" for name in known]
    for name in ("three_harmonics", "damped", "two_moduli"):
        paths += [f"{name}/{file}.nc" for file in ("sph", "reference_fd", "reference_exact")]
    for name in ("ten_harmonics", "damped_forced", "gaussian_coarse"):
        paths.append(f"{name}/reference_fd.nc")
    paths += ["high_frequency/sph.nc", "three_harmonics/uniform100/snapshots.nc"]
    sweeps = [("three_harmonics", "minimal")]
    sweeps += [("ten_harmonics", sampling) for sampling in NEEDED["ten_harmonics"]]
    return paths + [_sweep(config, *place) for place in sweeps]


def _references(name: str) -> tuple[str, ...]:
    return ("exact", "modified") if name == "high_frequency" else ("fd", "exact")


def _sweep(config, scene, sampling) -> str:
    modes = config["scenes"][scene]["samplings"][sampling]["mode_counts"]
    return f"{scene}/{sampling}/original/k{modes}.nc"


@dataclass(frozen=True)
class Paper:
    """What the studies see: the configuration, its results, and the numbers that the paper prints.

    Attributes
    ----------
    config : dict
        Resolved configuration.
    read : callable
        ``read(path, *names)`` gives arrays of a dataset by its path below the results, at the times
        of the error integral.
    """

    config: Mapping[str, Any]
    read: Callable[..., Arrays]

    def printed(self, scene: str | None, **criterion: Any) -> float | None:
        """What the paper prints, from the claim on a scene whose criterion has these entries."""
        for claim in self.config["claims"]:
            decided = claim["criterion"]
            if isinstance(decided, list):
                continue
            if claim.get("scene") == scene and criterion.items() <= decided.items():
                return claim["paper"]
        return None

    def printed_error(self, scene: str, field: str, against: str) -> float | None:
        """Error of full SPH as the paper prints it."""
        return self.printed(scene, kind="sph_error", field=field, reference=against)

    def scene(self, name: str, **changes: Any) -> Scene:
        """A scene with other settings; None takes one away."""
        settings = {**self.config["scenes"][name], **changes}
        return Scene.from_settings(
            name, {key: value for key, value in settings.items() if value is not None}
        )

    def sweep(self, scene: str, sampling: str) -> Arrays:
        """Errors of the original reduced model for all mode counts."""
        return self.read(_sweep(self.config, scene, sampling))

    def error(self, scene: str, field: str, against: str, solution: str = "sph") -> float:
        """Error of a solution as the results have it."""
        errors = self.read(f"{scene}/errors.nc")
        place = list(errors["solution"]).index(solution), list(errors["reference"]).index(against)
        return float(errors[f"{field}_error"][place])


class ReferenceErrors(NamedTuple):
    """Errors of full SPH against the reference that they are quoted against, and against the exact
    solution, beside the error of that reference itself (None where it is exact)."""

    scene: str
    quantity: str
    reference: str
    paper: float | None
    sph_against_reference: float
    sph_against_exact: float
    reference_against_exact: float | None


def reference_errors(
    config: Mapping[str, Any], read: Callable[..., Arrays]
) -> list[ReferenceErrors]:
    """Errors of full SPH and of its reference, for every scene that has the exact solution too."""
    paper = Paper(config, read)
    rows = []
    for scene, settings in config["scenes"].items():
        if "exact" not in settings["references"]:
            continue
        quoted = settings["references"][0]
        for field, symbol in FIELDS.items():
            exactly = paper.error(scene, field, "exact")
            own = None if quoted == "exact" else paper.error(scene, field, "exact", quoted)
            values = paper.printed_error(scene, field, quoted), paper.error(scene, field, quoted)
            rows.append(ReferenceErrors(scene, f"error of {symbol}", quoted, *values, exactly, own))
    return rows
