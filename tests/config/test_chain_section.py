"""Chains of masses and springs given as lists."""

import numpy as np
import pytest

from sphpod.config import config
from sphpod.config.reading import ConfigError
from sphpod.full import lifted
from sphpod.reference import chain
from sphpod.scene.scene import Scene

MASSES = [0.02, 0.04, 0.02, 0.03, 0.02, 0.05, 0.02, 0.03]
SPRINGS = [8.0, 6.0, 8.0, 7.0, 5.0, 8.0, 8.0, 9.0]
CHAIN = {
    "domain_length": 0.8,
    "duration": 1,
    "initial_velocity": "1e-3*sin(2*pi*x/L)",
    "masses": MASSES,
    "springs": SPRINGS,
    "particle_count": 8,
    "smoothing_ratio": 1.04,
    "time_step": 1e-3,
    "error_interval": 0.1,
}


def loaded(**changes):
    given = {key: value for key, value in (CHAIN | changes).items() if value is not None}
    return config.load([], {"scenes": {"own": given}})["scenes"]["own"]


def test_masses_and_springs_are_those_of_the_lists():
    settings = loaded()
    assert settings["references"] == ["chain"]
    scene = Scene.from_settings("own", settings)
    np.testing.assert_allclose(scene.density0() * scene.spacing, MASSES, rtol=1e-14)
    between = scene.youngs_modulus(x=scene.positions + scene.spacing / 2)
    np.testing.assert_allclose(between / scene.spacing, SPRINGS, rtol=1e-14)
    # A mass is pulled by both of its springs.
    both = (np.array(SPRINGS) + np.roll(SPRINGS, 1)) / 2 * scene.spacing
    np.testing.assert_allclose(scene.modulus(), both, rtol=1e-14)


def test_the_chain_moves_in_its_own_modes():
    """Frequencies are those of M⁻¹K, by another hand."""
    scene = Scene.from_settings("own", loaded(time_step=1e-4))
    stiffness = np.diag(np.array(SPRINGS) + np.roll(SPRINGS, 1))
    for n, k in enumerate(SPRINGS):
        m = (n + 1) % 8
        stiffness[n, m] -= k
        stiffness[m, n] -= k
    root = np.sqrt(MASSES)
    squares, modes = np.linalg.eigh(stiffness / np.outer(root, root))
    shares = modes.T @ (root * scene.velocity0())
    turned = shares * np.cos(np.outer(scene.error_times, np.sqrt(np.maximum(squares, 0))))
    expected = turned @ modes.T / root
    found = chain.solve(scene)["velocity"]
    np.testing.assert_allclose(found, expected, atol=3e-6 * np.abs(expected).max())
    assert np.isfinite(lifted.solve(scene, "exact")["velocity"]).all()


def test_a_chain_needs_no_defaults_of_density_and_modulus():
    defaults = {"initial_density": 1, "youngs_modulus": 0.1}
    settings = {"defaults": defaults, "scenes": {"own": dict(CHAIN)}}
    assert config.load([], settings)["scenes"]["own"] == loaded()


def test_a_chain_may_be_called_periodic():
    assert loaded(boundary="periodic")["references"] == ["chain"]


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"springs": None}, ["springs = (missing)", "belong together"]),
        ({"masses": MASSES[:7]}, ["masses = [0.02", "one for each of 8 particles, and has 7"]),
        ({"springs": [1, -1] * 4}, ["springs.1 = -1", "must be a positive number"]),
        ({"masses": [1] * 10001}, ["masses = [1, 1, 1]", "at most 10000 of them"]),
        ({"masses": "1"}, ["masses = 1", "list of positive numbers"]),
        ({"initial_density": 1}, ["initial_density = 1", "in the place of initial_density"]),
        ({"boundary": ["fixed", "fixed"]}, ["boundary", "periodic and evenly spaced"]),
    ],
)
def test_what_no_chain_is_is_refused(changes, parts):
    with pytest.raises(ConfigError, match=r"^scene own: ") as caught:
        loaded(**changes)
    assert all(part in str(caught.value) for part in parts)
    assert str(caught.value).count("\n") == 0


@pytest.mark.parametrize(
    "text", ["nth((), x)", "nth(3, x)", "nth((1, x), x)", "nth((1, 2), x, 3)", "nth((1, 2))"]
)
def test_other_uses_of_nth_are_refused(text):
    with pytest.raises(ConfigError, match=r"initial_velocity: .*nth"):
        loaded(initial_velocity=text)
