"""Errors of full SPH in variants of a scene."""

import numpy as np
import pytest
from scenes import VARIED, scene

from sphpod.full import sph
from sphpod.numerics.error import relative_error
from sphpod.reference import exact
from sphpod.studies import variants


def test_a_variant_is_the_scene_with_other_settings():
    case = scene()
    measured = variants.measure(
        case, {"fine": {"particle_count": 80}, "wide": {"smoothing_ratio": 1.2}}
    )
    assert measured["variant"].tolist() == ["own", "fine", "wide"]
    for n, other in enumerate((case, scene(particle_count=80), scene(smoothing_ratio=1.2))):
        found = sph.solve(other, other.error_steps)["velocity"]
        error = relative_error(found, exact.solve(other)["velocity"])
        assert measured["variant_velocity_error"][n] == pytest.approx(error, rel=1e-12)
    assert measured["variant_particle_count"].tolist() == [40, 80, 40]
    table = list(variants.rows({"scene": "waves"}, measured))
    assert [row["variant_smoothing_ratio"] for row in table] == [1.04, 1.04, 1.2]


def test_errors_fall_with_the_spacing_where_no_exact_solution_is_known():
    runs = {"fine": {"particle_count": 80, "time_step": 5e-4}}
    errors = variants.measure(scene(**VARIED), runs)["variant_velocity_error"]
    assert np.all(errors > 0)
    assert errors[1] < errors[0]
