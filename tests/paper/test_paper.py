"""The numbers that the paper prints, straight from the package."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from sphpod.config import config
from sphpod.full import sph
from sphpod.numerics import error
from sphpod.reduced import pod, rom, snapshots
from sphpod.reference import exact, reference
from sphpod.scene.scene import Scene

ROOT = Path(__file__).parents[2]
PAPER = config.load([ROOT / "config" / "config.yaml"])
SOLVERS = {"fd": reference.solve_paper, "exact": exact.solve, "modified": exact.solve_modified}
FIELDS = ("velocity", "density")

AGAINST_EXACT = {
    "three_harmonics": ("5.083e-02", "3.020e-04"),
    "ten_harmonics": ("8.999e-02", "3.292e-04"),
    "damped": ("6.901e-02", "2.744e-05"),
    "damped_forced": ("7.163e-03", "2.744e-05"),
    "two_moduli": ("6.315e-02", "1.008e-04"),
    "gaussian_coarse": ("2.040e-01", "1.481e-04"),
    "gaussian": ("5.125e-02", "3.709e-05"),
    "mildly_damped_forced": ("8.155e-02", "1.737e-04"),
}
"""Errors of full SPH in velocity and density against exact solutions, which the paper lacks."""

REDUCED = (
    ("three_harmonics", "minimal", "original", 4, "4.9e-04", "4.9e-05"),
    ("ten_harmonics", "uniform100", "frozen10", 12, "1.40e-01", "5.45e-04"),
    ("damped", "uniform12", "frozen10", 8, "2.99e-02", "2.03e-05"),
    ("damped_forced", "uniform12", "frozen10", 12, "5.14e-03", "1.05e-05"),
    ("damped_forced", "uniform12", "frozen10", 8, "9.54e-03", "4.62e-05"),
    ("two_moduli", "uniform40", "frozen10", 5, "4.78e-02", "6.38e-05"),
    ("mildly_damped_forced", "uniform20", "frozen10", 12, "3.00e-02", "6.88e-05"),
)
"""Errors of reduced models against full SPH: what the claims on them rest on."""


def scene(name):
    return Scene.from_settings(name, PAPER["scenes"][name])


def like(value, printed):
    """A number with as many digits as another one is printed with."""
    return f"{value:.{len(printed.partition('e')[0].partition('.')[2])}e}"


@lru_cache(maxsize=1)
def full(name):
    """Full SPH at the times of the error integral and of all snapshots."""
    steps = snapshots.output_steps(scene(name), PAPER["scenes"][name]["samplings"].values())
    solution = sph.solve(scene(name), steps)
    samples = np.isin(steps, scene(name).error_steps)
    return solution, {field: solution[field][samples] for field in FIELDS}


def printed_errors(name):
    """Reference, field and number of each error that the paper prints on a scene."""
    return [
        (claim["criterion"]["reference"], claim["criterion"]["field"], claim["paper"])
        for claim in PAPER["claims"]
        if claim["id"].startswith("E") and claim["scene"] == name
    ]


def test_there_are_18_errors():
    assert sum(len(printed_errors(name)) for name in PAPER["scenes"]) == 18


@pytest.mark.slow
@pytest.mark.parametrize("name", PAPER["scenes"])
def test_errors_have_the_printed_digits(name):
    _, solution = full(name)
    solved: dict[str, dict[str, np.ndarray]] = {}
    for kind, field, paper in printed_errors(name):
        if kind not in solved:
            solved = {kind: SOLVERS[kind](scene(name))}
        value = error.relative_error(solution[field], solved[kind][field])
        assert f"{value:.3e}" == f"{paper:.3e}", (kind, field)
    if name in AGAINST_EXACT:
        truth = exact.solve(scene(name))
        for field, expected in zip(FIELDS, AGAINST_EXACT[name], strict=True):
            value = error.relative_error(solution[field], truth[field])
            assert like(value, expected) == expected, field


@pytest.mark.parametrize(("name", "sampling", "method", "count", "velocity", "density"), REDUCED)
def test_errors_of_reduced_models(name, sampling, method, count, velocity, density):
    solution, samples = full(name)
    taken = snapshots.extract(scene(name), PAPER["scenes"][name]["samplings"][sampling], solution)
    modes = pod.decompose(taken)
    errors = rom.sweep(scene(name), method, [count], modes, samples, samples)
    assert like(errors["velocity_error_sph"][0], velocity) == velocity
    assert like(errors["density_error_sph"][0], density) == density
