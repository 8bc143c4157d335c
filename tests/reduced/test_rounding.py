"""What rounding makes of snapshots and modes, and that another processor makes no more of them."""

import os
import platform
import subprocess
import sys

import numpy as np
import pytest
from scenes import scene

from sphpod.full import sph
from sphpod.reduced import pod, rounding, snapshots

SAMPLING = {"range": [0, 0.5], "count": 5}

PROGRAM = """if True:
    import sys
    import numpy as np
    from sphpod.config import config
    from sphpod.numerics import error
    from sphpod.reduced import lifted_rom, pod, rom, rounding, snapshots
    from sphpod.full import sph
    from sphpod.scene.scene import Scene

    small = config.load(["config/small.yaml"])
    settings = small["scenes"]["waves"]
    scene = Scene.from_settings("waves", settings)
    # Late snapshots, and early ones, whose modes are weak.
    samplings = settings["samplings"] | {"early5": {"range": [0, 0.1], "count": 5}}
    full = sph.solve(scene, snapshots.output_steps(scene, samplings.values()))
    fields = {name: full[name][np.isin(full["t"], scene.error_times)] for name in error.FIELDS}
    results = {}
    for name, sampling in samplings.items():
        taken = snapshots.extract(scene, sampling, full) | rounding.twins(scene, sampling)
        modes = pod.decompose(taken)
        counts = range(1, 1 + sampling["count"])
        sweep = rom.sweep(scene, "original", counts, modes, fields, fields)
        for arrays in (taken, modes, lifted_rom.decompose(scene, taken), sweep):
            results |= {f"{name}/{key}": values for key, values in arrays.items()}
    np.savez(sys.argv[1], **results)
"""

FIELDS = ("velocity", "density", "scaled_velocity", "scaled_strain")


ERRORS = ("velocity_error_sph", "density_error_sph")


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"initial_velocity": 0, "force": {"time": "1e-2*cos(9*t)", "profile": "sin(2*pi*x/L)"}},
        {"positions": {"jitter": 0.2, "seed": 1}, "damping": 1},
    ],
    ids=["moving", "pushed from rest", "jittered"],
)
def test_twins_differ_from_snapshots_by_rounding_alone(changes):
    case = scene(**changes)
    solution = sph.solve(case, snapshots.output_steps(case, [SAMPLING]))
    taken = snapshots.extract(case, SAMPLING, solution)
    twins = rounding.twins(case, SAMPLING)
    for field in ("velocity", "density"):
        values, others = taken[f"{field}_snapshots"], twins[f"{field}_twins"]
        assert others.shape == values.shape
        assert 0 < np.abs(others - values).max() < 1e-10 * np.abs(values).max()
    again = rounding.twins(case, SAMPLING)
    assert all(np.array_equal(twins[name], again[name]) for name in twins)


def test_a_scene_in_which_nothing_moves_has_a_twin():
    for changes in ({"initial_velocity": 0}, {"initial_velocity": 1e-320}):
        twins = rounding.twins(scene(**changes), SAMPLING)
        assert np.isfinite(twins["velocity_twins"]).all()
        np.testing.assert_allclose(twins["density_twins"], 1, rtol=1e-12)


def test_the_last_place_is_one_unit():
    values = np.array([0.0, 1.0, -1.0, 1e300, -3e-310])
    changed = rounding.in_last_place(values)
    assert changed[0] == 0
    apart = np.array([0 if a == b else 1 for a, b in zip(values, changed, strict=True)])
    assert apart.tolist() == [0, 1, 1, 1, 1]
    assert np.all(np.abs(changed - values) <= np.spacing(np.abs(values)))


@pytest.fixture(scope="module")
def processors(tmp_path_factory):
    """Parts of config/small.yaml as two types of processors compute them."""
    if platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("types of processors are chosen by name, and the names are of x86")
    folder = tmp_path_factory.mktemp("processors")
    other = {
        "OPENBLAS_CORETYPE": "Prescott",
        "NUMBA_CPU_NAME": "generic",
        "NUMBA_CACHE_DIR": str(folder / "kernels"),
    }
    results = []
    for name, settings in (("own", {}), ("other", other)):
        path = folder / f"{name}.npz"
        subprocess.run(
            [sys.executable, "-c", PROGRAM, path],
            env=os.environ | settings | {"PYTHONPATH": os.getcwd()},
            check=True,
        )
        results.append(dict(np.load(path)))
    return results


@pytest.mark.workflow
def test_the_processors_round_differently(processors):
    own, other = processors
    differing = [key for key in own if not np.array_equal(own[key], other[key], equal_nan=True)]
    assert "uniform10/velocity_snapshots" in differing
    assert "uniform10/density_modes" in differing


@pytest.mark.workflow
@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("sampling", ["uniform10", "early5"])
def test_modes_are_the_same_on_both_where_they_are_resolved(processors, sampling, field):
    modes, turned = (
        [arrays[f"{sampling}/{field}_{name}"] for arrays in processors]
        for name in ("modes", "mode_rounding")
    )
    count = min(map(len, modes))
    known = np.maximum(*(rounding[:count] for rounding in turned)) <= pod.ROUNDING_LEVEL
    assert known[0]
    change = np.linalg.norm(modes[0][:count] - modes[1][:count], axis=1)
    # A mode of the opposite sign is changed by 2.
    assert np.all(change[known] <= 5 * pod.ROUNDING_LEVEL)


@pytest.mark.workflow
@pytest.mark.parametrize("sampling", ["uniform10", "early5"])
def test_errors_are_the_same_on_both_where_modes_are_resolved(processors, sampling):
    own, other = (
        {name: arrays[f"{sampling}/{name}"] for name in ("modes_resolved", *ERRORS)}
        for arrays in processors
    )
    known = own["modes_resolved"].astype(bool) & other["modes_resolved"].astype(bool)
    assert known[:8].all()
    assert known.all() == (sampling == "early5")
    for name in ERRORS:
        np.testing.assert_allclose(own[name][known], other[name][known], rtol=1e-2)
