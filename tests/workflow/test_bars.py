"""The bars of config/bars.yaml, made small, through the pipeline."""

from pathlib import Path

import numpy as np
import pytest
import runs
import xarray as xr
import yaml

from sphpod.pipeline import dataset
from sphpod.scene.scene import Scene

ROOT = Path(__file__).parents[2]
pytestmark = pytest.mark.workflow

SMALL = {"duration": 2, "particle_count": 41, "time_step": 1e-3, "error_interval": 0.01}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A folder in which figures, thresholds and bounds were made."""
    folder = tmp_path_factory.mktemp("bars")
    settings = yaml.safe_load((ROOT / "config/bars.yaml").read_text(encoding="utf-8"))
    settings["defaults"] |= SMALL
    for scene in settings["scenes"].values():
        scene["samplings"] = {"some": {"range": [0, 1], "count": 10}}
    (folder / "bars.yaml").write_text(yaml.safe_dump(settings), encoding="utf-8")
    files = ["--snakefile", ROOT / "Snakefile", "--configfile", "bars.yaml"]
    run = runs.run(folder, "all", "lifted", *files)
    assert run.returncode == 0, run.stderr
    return folder / "bars"


def test_files_hold_the_bar_alone(built):
    paths = list(built.glob("results/**/*.nc"))
    assert len(paths) > 20
    for path in paths:
        with xr.open_dataset(path) as file:
            assert file.sizes.get("x", 41) == 41, path
            if "x" in file:
                np.testing.assert_allclose(file.x, np.linspace(0, 1, 41), atol=1e-15)


def test_ends_are_as_they_are_called(built):
    for path in built.glob("results/*/sph.nc"):
        settings = dataset.settings(path)
        scene = Scene.from_settings(settings["scene"], settings)
        arrays = dataset.read(path, "velocity", "density")
        for place, end in zip((0, -1), settings["boundary"], strict=True):
            strains = scene.density0()[: scene.bar_count] / arrays["density"] - 1
            still = {"fixed": arrays["velocity"], "free": strains}[end][:, place]
            moving = {"fixed": strains, "free": arrays["velocity"]}[end][:, place]
            assert np.abs(still).max() < 1e-9 * np.abs(moving).max()


def test_bounds_hold(built):
    for path in built.glob("results/*/some/lifted_exact/*.nc"):
        arrays = dataset.read(path, "energy_error_lifted", "energy_error_bound")
        slack = 1e-9 + arrays["energy_error_bound"] - arrays["energy_error_lifted"]
        assert (slack >= 0).all(), path


def test_the_papers_models_are_of_fixed_ends_alone(built):
    assert {path.parent.parent.parent.name for path in built.glob("results/*/*/original/*.nc")} == {
        "clamped"
    }
    thresholds = (built / "results/thresholds.csv").read_text().splitlines()
    assert {line.split(",")[0] for line in thresholds[1:]} == {"clamped", "hanging", "flying"}
