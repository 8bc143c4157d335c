"""Errors of full SPH in variants of a scene: other particles, smoothing lengths or time steps."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sphpod.full import sph
from sphpod.numerics.error import FIELDS, Arrays, relative_error
from sphpod.pipeline.dataset import meanings
from sphpod.reference import exact, reference
from sphpod.scene.scene import Scene
from sphpod.studies.study import Dataset, Setting, Study

CHANGES = ("particle_count", "smoothing_ratio", "time_step")
"""Keys of a scene in which its variants may differ."""

OWN = "own"
"""Name of the scene as it is, among its variants."""


def measure(scene: Scene, runs: Mapping[str, Mapping[str, float]]) -> dict[str, np.ndarray]:
    """Errors of full SPH against the exact solution, or the centred one where none is known.

    Parameters
    ----------
    runs : dict
        particle_count, smoothing_ratio or time_step [s] of each variant, by its name.

    Returns
    -------
    dict
        As `STUDY` describes it, the scene's own first.

    Raises
    ------
    Breakdown
        Full SPH of a variant broke down.
    """
    cases = {OWN: scene} | {name: _changed(scene, changes) for name, changes in runs.items()}
    errors = np.array([_errors(case) for case in cases.values()])
    return {
        "variant": np.array(list(cases)),
        "variant_particle_count": np.array([case.bar_count for case in cases.values()]),
        "variant_smoothing_ratio": np.array([case.smoothing_ratio for case in cases.values()]),
    } | {f"variant_{field}_error": errors[:, n] for n, field in enumerate(FIELDS)}


def _changed(scene, changes):
    particles = scene.line_count(int(changes.get("particle_count", scene.bar_count)))
    ratio = float(changes.get("smoothing_ratio", scene.smoothing_ratio))
    step = float(changes.get("time_step", scene.time_step))
    return replace(scene, particle_count=particles, smoothing_ratio=ratio, time_step=step)


def _errors(scene):
    if exact.kind(scene):
        known = exact.solve(scene)
    else:
        known = reference.solve_centred(scene, estimate_error=False)
    found = sph.solve(scene, scene.error_steps)
    return [relative_error(found[field], known[field]) for field in FIELDS]


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """Rows of a table, one a variant."""
    for n, name in enumerate(arrays["variant"]):
        yield {
            "scene": place["scene"],
            "variant": str(name),
            **{key: arrays[key][n].item() for key in arrays if key.startswith("variant_")},
        }


STUDY = Study(
    target="all",
    datasets={
        "variants": Dataset(
            compute="studies.variants.measure",
            message="{scene}: errors of full SPH in variants of it",
            arguments={"runs": lambda scene, setting: setting("studies.variants.runs")[scene.name]},
            places=lambda config: [(name,) for name in config["studies"]["variants"]["runs"]],
            only_asked=True,
        )
    },
    tables={"variants": ("studies.variants.rows", "variants")},
    settings={
        "runs": Setting(
            dict[str, dict[str, dict[str, float]]],
            {},
            description="variants by name, of scenes by name: their particle_count, "
            "smoothing_ratio or time_step",
        )
    },
    variables=meanings(
        """
        variant (variant_index): name of the variant, own for the scene
        variant_particle_count (variant_index) [1] int32: particles of the variant
        variant_smoothing_ratio (variant_index) [1]: smoothing length of the variant, in spacings
        variant_velocity_error (variant_index) [1]: relative L2 error of full SPH in velocity
        variant_density_error (variant_index) [1]: relative L2 error of full SPH in density
        """
    ),
)
