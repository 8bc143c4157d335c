"""Datasets: what is written is read, says what it is, and is whole."""

import json
import os
import random
import subprocess
import sys
import time
from importlib import metadata

import netCDF4
import numpy as np
import pandas as pd
import pytest
import xarray as xr

from sphpod import __version__
from sphpod.pipeline import dataset, job

SETTINGS = {"scene": "waves", "time_step": 2e-4, "references": ["fd", "exact"]}


def write(path, arrays):
    dataset.write(path, arrays, title="A title", settings=SETTINGS, code="c0de")


def solution(times=7, particles=5):
    rng = np.random.default_rng(1)
    return {
        "t": np.arange(times) * 0.1,
        "x": np.arange(particles) / particles,
        "velocity": rng.normal(size=(times, particles)),
        "density": 1 + rng.normal(size=(times, particles)),
        "error_sample": np.arange(times) % 2 == 0,
    }


def test_arrays_come_back(tmp_path):
    arrays = solution()
    write(tmp_path / "new" / "sph.nc", arrays)
    back = dataset.read(tmp_path / "new" / "sph.nc")
    assert list(back) == list(arrays)
    for name, values in arrays.items():
        np.testing.assert_array_equal(back[name], values)
    assert list(dataset.read(tmp_path / "new" / "sph.nc", "x")) == ["x"]


def test_text_whole_numbers_nan_and_scalars_come_back(tmp_path):
    arrays = {
        "solution": np.array(["sph", "fd"]),
        "reference": np.array(["exact"]),
        "velocity_error": np.array([[0.5], [np.nan]]),
        "mode_count": np.array([1, 2, 3]),
        "velocity_error_estimate": np.array(1e-5),
    }
    write(tmp_path / "errors.nc", arrays)
    back = dataset.read(tmp_path / "errors.nc")
    for name, values in arrays.items():
        np.testing.assert_array_equal(back[name], values)
    assert back["solution"].dtype.kind == "U"
    assert back["mode_count"].dtype.kind == "i"


def test_samples_of_the_error_integral(tmp_path):
    arrays = solution()
    write(tmp_path / "sph.nc", arrays)
    samples = dataset.read_samples(tmp_path / "sph.nc")
    assert "error_sample" not in samples
    np.testing.assert_array_equal(samples["t"], arrays["t"][::2])
    np.testing.assert_array_equal(samples["velocity"], arrays["velocity"][::2])
    np.testing.assert_array_equal(samples["x"], arrays["x"])
    del arrays["error_sample"]
    write(tmp_path / "reference.nc", arrays)
    np.testing.assert_array_equal(
        dataset.read_samples(tmp_path / "reference.nc", "density")["density"], arrays["density"]
    )


def test_a_file_describes_itself(tmp_path):
    write(tmp_path / "sph.nc", solution())
    assert dataset.settings(tmp_path / "sph.nc") == SETTINGS
    with xr.open_dataset(tmp_path / "sph.nc") as file:
        assert file.attrs["Conventions"] == "CF-1.11"
        assert file.attrs["title"] == "A title"
        source = file.attrs["source"]
        assert source.startswith(f"sphpod {__version__}, code c0de; Python ")
        for library in ("numpy", "scipy", "numba", "llvmlite", "netCDF4"):
            assert f", {library} {metadata.version(library)}" in source
        assert "Mass-Spring-Damper" in file.attrs["references"]
        assert file.attrs["settings"] == json.dumps(SETTINGS, sort_keys=True)
        assert file.velocity.dims == ("t", "x")
        assert file.velocity.dtype == np.float64
        assert file.velocity.attrs == {"units": "m s-1", "long_name": "velocity of the particles"}
        assert "_FillValue" not in file.velocity.encoding


def test_every_variable_is_described():
    for name, variable in dataset.VARIABLES.items():
        assert variable.long_name, name
        assert (variable.units == "") == (variable.dtype is str), name


def test_same_data_same_bytes_in_every_process(tmp_path):
    arrays = solution() | {"solution": np.array(["sph", "linearized"])}
    for name in ("a.nc", "b.nc"):
        write(tmp_path / name, arrays)
        time.sleep(0.01)
    program = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_dataset as t, numpy as np;"
        "t.write(sys.argv[2], t.solution() | {'solution': np.array(['sph', 'linearized'])})"
    )
    folder = os.path.dirname(__file__)
    subprocess.run([sys.executable, "-c", program, folder, tmp_path / "c.nc"], check=True)
    contents = {(tmp_path / name).read_bytes() for name in ("a.nc", "b.nc", "c.nc")}
    assert len(contents) == 1


def spoil(path, content):
    spoilt = path.with_name(f"{len(list(path.parent.iterdir()))}.nc")
    spoilt.write_bytes(content)
    return spoilt


def test_any_flipped_bit_is_found(tmp_path):
    write(tmp_path / "sph.nc", solution() | {"solution": np.array(["sph", "fd"])})
    content, draw = (tmp_path / "sph.nc").read_bytes(), random.Random(0)
    ends = [*range(20), *range(len(content) - 40, len(content))]
    for place in ends + draw.sample(range(len(content)), 400):
        flipped = bytearray(content)
        flipped[place] ^= 1 << draw.randrange(8)
        path = spoil(tmp_path / "sph.nc", flipped)
        with pytest.raises(ValueError, match="is not what its rule wrote; delete it"):
            dataset.read(path, "x")


@pytest.mark.parametrize("part", [0, 0.01, 0.5, 0.999])
def test_part_of_a_file_and_text_are_refused(tmp_path, part):
    write(tmp_path / "sph.nc", solution())
    content = (tmp_path / "sph.nc").read_bytes()
    for spoilt in (content[: int(part * len(content))], b"velocity" * int(1000 * part)):
        path = spoil(tmp_path / "sph.nc", spoilt)
        for reader in (dataset.read, dataset.read_samples, dataset.settings, dataset.job):
            with pytest.raises(ValueError, match="is not what its rule wrote; delete it"):
                reader(path)


def test_a_file_that_another_tool_changed_or_wrote_is_refused(tmp_path):
    write(tmp_path / "sph.nc", solution())
    with netCDF4.Dataset(tmp_path / "sph.nc", "a") as file:
        file.title = "Another title"
    xr.Dataset({"velocity": ("t", [1.0])}).to_netcdf(tmp_path / "other.nc")
    for name in ("sph.nc", "other.nc"):
        with pytest.raises(ValueError, match=f"{name}: is not what its rule wrote; delete it"):
            dataset.settings(tmp_path / name)


def test_a_file_that_changes_after_it_was_read_is_looked_at_again(tmp_path):
    path = tmp_path / "sph.nc"
    write(path, solution())
    assert dataset.settings(path) == SETTINGS
    content = path.read_bytes()
    path.write_bytes(content.replace(b"waves", b"wives"))
    with pytest.raises(ValueError, match="is not what its rule wrote; delete it"):
        dataset.settings(path)


def test_what_the_system_says_of_a_file_is_enough(tmp_path):
    with pytest.raises(FileNotFoundError):
        dataset.read(tmp_path / "missing.nc")


def test_a_file_tells_what_its_job_was_given(tmp_path):
    write(tmp_path / "sph.nc", solution())
    assert dataset.job(tmp_path / "sph.nc") is None
    told = {"rule": "sph", "output": ["waves/sph.nc"], "params": ["{'a': 1}"]}
    path = tmp_path / "waves" / "sph.nc"
    for place in (path, tmp_path / "graded" / "sph.nc"):
        dataset.write(place, solution(), title="", settings=SETTINGS, code="", job=told)
    assert job.given(path) == told
    with pytest.raises(ValueError, match=r"graded/sph\.nc: is not what its rule wrote; delete it"):
        job.given(tmp_path / "graded" / "sph.nc")


def test_unknown_names_and_wrong_shapes_are_refused(tmp_path):
    with pytest.raises(KeyError, match="no variable is named 'speed'"):
        write(tmp_path / "sph.nc", {"speed": np.zeros(3)})
    with pytest.raises(ValueError, match="does not fit"):
        write(tmp_path / "sph.nc", {"t": np.zeros(3), "velocity": np.zeros((4, 2))})
    with pytest.raises(ValueError, match="does not fit"):
        write(tmp_path / "sph.nc", {"velocity": np.zeros(3)})
    write(tmp_path / "sph.nc", {"t": np.zeros(3)})
    with pytest.raises(KeyError, match="holds t, but not velocity"):
        dataset.read(tmp_path / "sph.nc", "velocity")


def test_no_value_is_stored_in_a_type_that_cannot_hold_it(tmp_path):
    steps = np.array([0, 0, 10**11, 999_999_999_999_999])
    write(tmp_path / "a.nc", {"n_freeze": steps})
    assert dataset.read(tmp_path / "a.nc")["n_freeze"].tolist() == steps.tolist()
    for name, value in {
        "mode_count": [2**31],
        "error_sample": [256],
        "best_mode_count": 1.5,
    }.items():
        with pytest.raises(ValueError, match=f"{name} = .* does not fit the type int"):
            write(tmp_path / "b.nc", {name: np.array(value)})
    with pytest.raises(ValueError, match="mode_count = nan does not fit"):
        write(tmp_path / "b.nc", {"mode_count": np.array([np.nan])})
    assert not (tmp_path / "b.nc").exists()


def test_a_failed_write_leaves_the_old_file_alone(tmp_path):
    path = tmp_path / "sph.nc"
    write(path, {"t": np.zeros(3)})
    before = path.read_bytes()
    with pytest.raises(ValueError, match="JSON"):
        dataset.write(path, {"t": np.ones(3)}, title="", settings={"a": float("nan")}, code="")
    assert path.read_bytes() == before
    assert [entry.name for entry in tmp_path.iterdir()] == ["sph.nc"]


def test_what_a_killed_process_left_is_removed(tmp_path):
    program = (
        "import sys, os; from sphpod.pipeline import dataset\n"
        "with dataset.whole(sys.argv[1]) as partial:\n"
        "    partial.write_text('half'); os.kill(os.getpid(), 9)"
    )
    path = tmp_path / "k1-20.nc"
    subprocess.run([sys.executable, "-c", program, path], check=False)
    (left,) = tmp_path.iterdir()
    assert left != path
    write(path, {"t": np.zeros(3)})
    assert [entry.name for entry in tmp_path.iterdir()] == ["k1-20.nc"]


def test_names_of_unfinished_files_are_unique(tmp_path):
    with dataset.whole(tmp_path / "a.nc") as first:
        with dataset.whole(tmp_path / "a.nc") as second:
            assert first != second
            second.write_text("second")
        first.write_text("first")
    assert (tmp_path / "a.nc").read_text() == "first"


def test_new_files_have_the_usual_permissions(tmp_path):
    (tmp_path / "usual").touch()
    write(tmp_path / "sph.nc", {"t": np.zeros(3)})
    assert (tmp_path / "sph.nc").stat().st_mode == (tmp_path / "usual").stat().st_mode


def test_tables_are_plain_csv(tmp_path):
    dataset.write_table(tmp_path / "t.csv", pd.DataFrame({"id": ["E01"], "paper": [4.52e-2]}))
    assert (tmp_path / "t.csv").read_bytes() == b"id,paper\nE01,0.0452\n"


def test_files_are_such_as_other_tools_read(tmp_path):
    """CF: text labels a dimension of another name, and NaN is declared."""
    arrays = {
        "mode_count": np.array([1, 2]),
        "breakdown_time": np.array([np.nan, 0.5]),
        "velocity_error_sph": np.array([0.1, 0.2]),
        "solution": np.array(["sph", "fd"]),
        "reference": np.array(["fd"]),
        "velocity_error": np.array([[0.1], [np.nan]]),
    }
    settings = {"scene": "waves", "sampling": {"name": "few", "count": 3}}
    record = {"output": ["waves/few/original/k1-2.nc"]}
    path = tmp_path / "k1-2.nc"
    dataset.write(path, arrays, title="A title", settings=settings, code="c0de", job=record)
    with xr.open_dataset(path) as file:
        assert file.attrs["history"] == "snakemake results/waves/few/original/k1-2.nc"
        assert (file.scene.item(), file.sampling.item()) == ("waves", "few")
        assert set(file.velocity_error.coords) == {"solution", "reference", "scene", "sampling"}
        chosen = file.set_xindex("solution").velocity_error.sel(solution="sph")
        assert chosen.item() == 0.1
        declared = {name for name in file.variables if "_FillValue" in file[name].encoding}
        assert declared == {"breakdown_time", "velocity_error"}
        for name, variable in file.variables.items():
            assert variable.dtype.kind not in "OUT" or name not in variable.dims
    back = dataset.read(path)
    assert set(back) == set(arrays)
    for name, values in arrays.items():
        np.testing.assert_array_equal(back[name], values)


def test_a_table_says_what_names_mean():
    found = dataset.meanings("""
        peak (t, x) [m s-1] along t0: the largest velocity, of
            all there are
        count () [1] int32: how many
        model (model_index): which: one
    """)
    assert found == {
        "peak": dataset.Variable(
            ("t", "x"), "m s-1", "the largest velocity, of all there are", coordinates="t0"
        ),
        "count": dataset.Variable((), "1", "how many", np.int32),
        "model": dataset.Variable(("model_index",), "", "which: one", str),
    }


@pytest.mark.parametrize("table", ["a (t) [s] time", "a (t) [s]: time\na (t) [s]: once more"])
def test_a_table_without_a_meaning_or_with_two_is_refused(table):
    with pytest.raises(ValueError, match="is no variable of its own"):
        dataset.meanings(table)
