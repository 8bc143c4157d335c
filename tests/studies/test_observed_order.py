"""Observed orders are those of the methods, and of nothing where errors are rounding."""

from typing import Any

import numpy as np
import pytest
from figure_checks import check_layout
from scenes import VARIED, scene

from sphpod.pipeline import dataset
from sphpod.studies import observed_order
from sphpod.studies.study import studies

IN_TIME = {
    ("sph", "explicit_euler"): 1,
    ("lifted_full", "explicit_euler"): 1,
    ("lifted_full", "symplectic_euler"): 1,
    ("lifted_full", "leapfrog"): 2,
    ("lifted_full", "rk45"): 5,
    ("lifted_full", "dop853"): 8,
}
SETTINGS: dict[str, dict[str, Any]] = {"plain": {}, "varied": VARIED}


def long(changes):
    """A scene of which a tenth is long enough for waves to move."""
    wave = "1e-3*sin(6*pi*x/L)"
    return scene(
        duration=20, error_interval=0.1, particle_count=160, initial_velocity=wave, **changes
    )


@pytest.fixture(scope="module", params=list(SETTINGS.values()), ids=list(SETTINGS))
def arrays(request):
    return observed_order.study(long(request.param), 3)


def of(arrays, *label):
    """Number of the refinement with a label, model, integrator, refinement and against."""
    names = ("refined_model", "refined_integrator", "refinement", "refined_against")
    labels = list(zip(*(arrays[name].tolist() for name in names), strict=True))
    (found,) = (n for n, one in enumerate(labels) if one[: len(label)] == label)
    return found


@pytest.mark.parametrize("label", IN_TIME, ids=" ".join)
def test_integrators_have_their_order_in_time(arrays, label):
    n = of(arrays, *label, "time")
    orders = arrays["refined_velocity_order"][n]
    known = orders[~np.isnan(orders)]
    assert known.size
    assert known[-1] == pytest.approx(IN_TIME[label], abs=0.3)


def test_references_have_their_order_in_space(arrays, request):
    """The paper's sees the density half a node beside, where it varies at first order."""
    varied = "varied" in request.node.name
    for model, velocity, density in (
        ("reference_fd", 1 if varied else 2, 1),
        ("reference_centred", 2, 2),
    ):
        n = of(arrays, model, "midpoint", "space", "next finer grid")
        assert arrays["refined_velocity_order"][n, 0] == pytest.approx(velocity, abs=0.2)
        assert arrays["refined_density_order"][n, 0] == pytest.approx(density, abs=0.2)


def test_sph_tends_to_the_modified_solution_and_not_to_the_exact_one():
    """With a ratio of smoothing length and spacing that is fixed, waves stay faster by β."""
    plain = observed_order.study(long({"smoothing_ratio": 0.9}), 4)
    modified, exact = (
        plain["refined_velocity_error"][of(plain, "lifted_full", "exact", "space", against)]
        for against in ("modified", "exact")
    )
    assert observed_order.orders(modified)[-1] == pytest.approx(2, abs=0.1)
    assert exact[-1] > 10 * modified[-1]
    assert observed_order.orders(exact)[-1] < 0.5


def test_rounding_has_no_order():
    errors = np.array([[1e-2, 2.5e-3], [1e-11, 1e-14], [0, 0], [np.nan, 1e-3]])
    expected = [[2], [np.nan], [np.nan], [np.nan]]
    np.testing.assert_array_equal(observed_order.orders(errors), expected)


def test_a_table_has_a_row_for_each_level(arrays, tmp_path):
    path = tmp_path / "observed_order.nc"
    variables = studies()["observed_order"].variables
    dataset.write(path, arrays, title="", settings={}, code="", variables=variables)
    rows = list(observed_order.rows({"scene": "test", "sampling": ""}, dataset.read(path)))
    assert len(rows) == arrays["refined_time_step"].size
    assert all(np.isnan(row["velocity_order"]) for row in rows[::3])
    in_time = [row for row in rows if row["refinement"] == "time"]
    assert [row["time_step"] for row in in_time[:3]] == [1e-3, 5e-4, 2.5e-4]


def test_scenes_in_which_nothing_moves_have_no_order():
    found = observed_order.study(scene(initial_velocity=0), 3)
    assert not np.nan_to_num(found["refined_velocity_error"]).any()
    assert np.isnan(found["refined_velocity_order"]).all()


def test_nothing_overlaps(arrays):
    figure = observed_order.draw({("test",): arrays, ("another_scene",): arrays})
    check_layout(figure)
    assert [axes.get_title() for axes in figure.axes] == ["velocity", "density"]
