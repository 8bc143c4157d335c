"""Errors over both mode counts."""

import numpy as np
import pytest
from figure_checks import check_layout
from scenes import scene

from sphpod.full import sph
from sphpod.numerics import error
from sphpod.reduced import pod, rom, snapshots
from sphpod.reference import exact
from sphpod.studies import mode_pairs

SAMPLING = {"range": [0, 1], "count": 9}


@pytest.fixture(scope="module")
def solved():
    case = scene()
    steps = snapshots.output_steps(case, [SAMPLING])
    full = sph.solve(case, steps)
    modes = pod.decompose(snapshots.extract(case, SAMPLING, full))
    kept = np.isin(steps, case.error_steps)
    full = {field: full[field][kept] for field in error.FIELDS}
    known = exact.solve(case)
    errors = {
        f"{field}_error": np.array([[error.relative_error(full[field], known[field])]])
        for field in error.FIELDS
    }
    return case, modes, full, known, errors


def test_the_diagonal_is_the_sweep(solved):
    case, modes, full, known, errors = solved
    pairs = mode_pairs.measure(case, 5, modes, full, errors)
    sweep = rom.sweep(case, "original", range(1, 6), modes, full, known)
    for field in error.FIELDS:
        expected = sweep[f"{field}_error_sph"] / errors[f"{field}_error"][0, 0]
        np.testing.assert_allclose(np.diag(pairs[f"pair_{field}_ratio"]), expected, rtol=1e-6)
    check_layout(mode_pairs.draw(pairs))


def test_pairs_near_rounding_are_hatched(solved):
    case, modes, full, _, errors = solved
    turned = np.where(np.arange(modes["velocity_modes"].shape[0]) < 3, 0.0, 1.0)
    modes = {**modes, "velocity_span_rounding": turned, "density_span_rounding": 0 * turned}
    pairs = mode_pairs.measure(case, 5, modes, full, errors)
    np.testing.assert_array_equal(pairs["pair_resolved"], np.arange(5)[:, None] < 3 + np.zeros(5))
    figure = mode_pairs.draw(pairs)
    hatched = [mesh for mesh in figure.axes[0].collections if mesh.get_hatch()]
    assert [len(mesh.get_paths()) for mesh in hatched] == [10]
    assert "hatched" in figure.axes[0].get_title(loc="left")
    check_layout(figure)
    pairs["pair_resolved"][:] = True
    figure = mode_pairs.draw(pairs)
    assert not any(mesh.get_hatch() for mesh in figure.axes[0].collections)


def test_one_model_of_a_pair_is_that_of_the_map(solved):
    case, modes, full, known, errors = solved
    pairs = mode_pairs.measure(case, 5, modes, full, errors)
    one = rom.sweep_pair(case, "original", [2, 4], modes, full, known)
    assert (one["velocity_mode_count"], one["density_mode_count"]) == (2, 4)
    assert one["velocity_coordinates"].shape[1] == 2
    assert one["density_coordinates"].shape[1] == 4
    for field in error.FIELDS:
        ratio = one[f"{field}_error_sph"][0] / errors[f"{field}_error"][0, 0]
        assert pairs[f"pair_{field}_ratio"][1, 3] == pytest.approx(ratio, rel=1e-6)


def test_the_table_gives_the_fewest_density_modes_that_work():
    arrays = {
        "velocity_modes_kept": np.array([1, 2]),
        "density_modes_kept": np.array([1, 2, 3]),
        "pair_velocity_ratio": np.array([[2, 2, np.inf], [2, 0.5, 0.4]]),
        "pair_density_ratio": np.array([[2, 0.5, np.inf], [0.5, 0.9, 0.4]]),
        "pair_resolved": np.array([[1, 1, 0], [1, 1, 0]]),
    }
    rows = list(mode_pairs.rows({"scene": "a", "sampling": "b"}, arrays))
    assert [row["fewest_density_modes"] for row in rows] == [None, 2]
    check_layout(mode_pairs.draw(arrays))


def test_colours_have_a_tick_at_one_and_say_where_they_are_cut() -> None:
    """A ratio of 1 parts what works from what does not; colours end at 10⁴ to either side."""
    for sizes, extend in (((1e-6, 0.5), "min"), ((0.2, 3.0), "neither"), ((1e-5, 1e5), "both")):
        ratio = np.array([sizes, sizes[::-1]])
        pairs = {
            "velocity_modes_kept": np.arange(1, 3),
            "density_modes_kept": np.arange(1, 3),
            "pair_velocity_ratio": ratio,
            "pair_density_ratio": ratio,
            "pair_resolved": np.ones((2, 2)),
        }
        figure = mode_pairs.draw(pairs)
        bar = figure.axes[0].collections[0].colorbar
        assert bar is not None
        assert bar.extend == extend
        assert 1.0 in bar.get_ticks()
        figure.draw_without_rendering()
