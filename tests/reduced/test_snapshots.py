"""Sampling times and snapshots."""

import numpy as np
import pytest
import xarray as xr
from scenes import scene

from sphpod.full import sph
from sphpod.pipeline import dataset
from sphpod.reduced import snapshots


@pytest.mark.parametrize(
    ("sampling", "dt", "times"),
    [
        ({"range": [0, 1.6], "count": 100}, 2e-4, np.arange(100) * 0.016),
        ({"range": [0, 1.44], "count": 12}, 2e-4, np.arange(12) * 0.12),
        ({"range": [0, 0.1], "count": 5}, 2e-4, [0, 0.02, 0.04, 0.06, 0.08]),
        ({"range": [0, 1.5], "count": 15}, 5e-5, np.arange(15) * 0.1),
        ({"range": [0.2, 0.6], "count": 4}, 1e-3, [0.2, 0.3, 0.4, 0.5]),
    ],
)
def test_uniform_samplings_leave_out_the_right_end(sampling, dt, times):
    case = scene(duration=10, time_step=dt)
    velocity, density = snapshots.sampling_steps(case, sampling)
    np.testing.assert_allclose(velocity * dt, times, atol=1e-12)
    assert np.array_equal(velocity, density)


def test_times_between_steps_go_to_the_nearest():
    case = scene(time_step=1e-3)
    steps, _ = snapshots.sampling_steps(case, {"range": [0, 1], "count": 7})
    assert steps.tolist() == [0, 143, 286, 429, 571, 714, 857]


def test_random_samplings_are_distinct_seeded_and_within_their_range():
    case = scene(time_step=1e-3)
    sampling = {"range": [0.1, 0.3], "count": 150, "seed": 3}
    steps, _ = snapshots.sampling_steps(case, sampling)
    assert len(set(steps.tolist())) == 150
    assert steps.min() >= 100
    assert steps.max() < 300
    assert np.array_equal(steps, snapshots.sampling_steps(case, sampling)[0])
    other, _ = snapshots.sampling_steps(case, sampling | {"seed": 4})
    assert not np.array_equal(steps, other)


def test_times_touched_by_rounding_are_those_of_whole_steps():
    case = scene(duration=0.3, time_step=0.1 / 128, error_interval=0.1)
    given = {"velocity_times": [0, 0.1 + 0.2], "density_times": [0.1 + 0.2]}
    assert [steps.tolist() for steps in snapshots.sampling_steps(case, given)] == [[0, 384], [384]]
    # Halves of a step go to the even one, whichever side of the end rounding has put the range.
    for end in (0.3, 0.1 + 0.2, np.nextafter(0.3, 0)):
        steps, _ = snapshots.sampling_steps(case, {"range": [0, end], "count": 256})
        assert steps.tolist() == [round(1.5 * n) for n in range(256)]
        drawn, _ = snapshots.sampling_steps(case, {"range": [0, end], "count": 384, "seed": 1})
        assert drawn.tolist() == list(range(384))


def test_times_of_files_are_decimal_and_those_of_other_steps_the_same(tmp_path):
    """All 101 samples are found by their decimal time, and none is lost in a difference."""
    files = []
    for number, dt in enumerate((1e-3, 2.5e-4, 1 / 300)):
        case = scene(time_step=dt)
        steps = snapshots.output_steps(case, [{"velocity_times": [0.3], "density_times": [0.7]}])
        files.append(tmp_path / f"{number}.nc")
        solution = sph.solve(case, steps)
        dataset.write(files[-1], solution, title="test", settings={}, code="c0de")
    first, *others = (xr.open_dataset(path).velocity for path in files)
    assert first.sel(t=[float(f"{n}e-2") for n in range(101)]).sizes["t"] == 101
    for other in others:
        assert (other - first).sizes["t"] == 101


def test_snapshots_are_the_solution_at_their_times():
    case = scene()
    sampling = {"velocity_times": [0, 0.123, 0.4], "density_times": [0.007, 0.4]}
    steps = snapshots.output_steps(case, [sampling])
    assert np.isin(case.error_steps, steps).all()
    taken = snapshots.extract(case, sampling, sph.solve(case, steps))
    for field in ("velocity", "density"):
        np.testing.assert_allclose(taken[f"{field}_time"], sampling[f"{field}_times"], atol=1e-15)
        alone = sph.solve(case, np.rint(taken[f"{field}_time"] / 1e-3).astype(np.int64))
        np.testing.assert_array_equal(taken[f"{field}_snapshots"], alone[field])


def test_a_solution_without_a_snapshot_time_is_refused():
    case = scene()
    solution = sph.solve(case, case.error_steps)
    with pytest.raises(ValueError, match="was not kept at every velocity snapshot"):
        snapshots.extract(case, {"range": [0, 1], "count": 7}, solution)


def test_a_file_of_ones_own_gives_the_same_snapshots(tmp_path):
    """Taken from full SPH by hand, under either of the names that it may have."""
    case, sampling = scene(), {"range": [0, 1], "count": 9}
    full = sph.solve(case, snapshots.output_steps(case, [sampling]))
    taken = snapshots.extract(case, sampling, full)
    dims = {"x": ("x",), "velocity_snapshots": ("velocity_time", "x"),
            "density_snapshots": ("density_time", "x")}  # fmt: skip
    named = {name: (dims.get(name, (name,)), values) for name, values in taken.items()}
    xr.Dataset(named).to_netcdf(tmp_path / "taken.nc", engine="netcdf4")
    plain = {"t": taken["velocity_time"]} | {
        field: (("t", "x"), taken[f"{field}_snapshots"]) for field in ("velocity", "density")
    }
    xr.Dataset(plain).to_netcdf(tmp_path / "plain.nc", engine="netcdf4")
    for name in ("taken.nc", "plain.nc"):
        path = str(tmp_path / name)
        found = snapshots.own(case, {"from": path})
        assert set(found) == set(taken)
        for key, values in taken.items():
            np.testing.assert_array_equal(found[key], values)
        assert snapshots.described(case, path)["counts"] == [9, 9]


@pytest.mark.parametrize(
    ("change", "answer"),
    [
        ({"velocity": None}, "it holds t, density, but not velocity"),
        ({"velocity": np.zeros((3, 7))}, r"velocity is of shape \(3, 7\); needed is one row for"),
        ({"density": np.zeros((3, 40))}, "density must be finite and positive everywhere"),
        ({"velocity": np.full((3, 40), np.nan)}, "velocity must be finite everywhere"),
    ],
)
def test_files_that_are_no_snapshots_of_the_scene_are_refused(tmp_path, change, answer):
    arrays = {"t": np.arange(3.0), "velocity": np.zeros((3, 40)), "density": np.ones((3, 40))}
    held = {name: values for name, values in (arrays | change).items() if values is not None}
    dims = {"t": ("t",), "velocity": ("t", "p"), "density": ("t", "x")}
    xr.Dataset({name: (dims[name], values) for name, values in held.items()}).to_netcdf(
        tmp_path / "mine.nc", engine="netcdf4"
    )
    with pytest.raises(ValueError, match=answer):
        snapshots.own(scene(particle_count=40), {"from": str(tmp_path / "mine.nc")})
    with pytest.raises(ValueError, match="there is no such file"):
        snapshots.own(scene(), {"from": str(tmp_path / "nothing.nc")})
