"""What a configuration may ask of bars with ends."""

import copy

import pytest

from sphpod.config import config
from sphpod.config.reading import ConfigError
from sphpod.studies.study import studies

BAR = {
    "boundary": ["fixed", "free"],
    "domain_length": 1,
    "duration": 1,
    "initial_velocity": "1e-3*sin(pi*x/2)",
    "initial_density": 1,
    "youngs_modulus": 0.1,
    "particle_count": 21,
    "smoothing_ratio": 1.04,
    "time_step": 0.002,
    "error_interval": 0.01,
    "samplings": {"some": {"range": [0, 1], "count": 10}},
}
DENSITY = "the original, linearized and frozen models step the density"


def resolved(changes=None, **more):
    """The configuration of a bar, with keys set in it, and others beside its scene."""
    return config.load(
        [], overrides={"scenes": {"bar": copy.deepcopy(BAR) | (changes or {})}} | more
    )


def refusal(changes=None, **more):
    with pytest.raises(ConfigError) as refused:
        resolved(changes, **more)
    return str(refused.value)


def test_free_ends_have_no_figure_of_the_papers_errors():
    def kinds(**changes):
        return [figure["kind"] for figure in resolved(changes)["scenes"]["bar"]["figures"]]

    assert kinds() == ["profile", "modes"]
    fixed = {"boundary": ["fixed", "fixed"], "initial_velocity": "1e-3*sin(pi*x)"}
    assert kinds(**fixed) == ["profile", "modes", "error"]


def test_what_the_papers_models_do_is_refused_of_free_ends():
    acceleration = {"some": {"mode_counts": [4], "n_freeze": [1]}}
    for said in (
        refusal({"acceleration": acceleration}),
        refusal({"figures": [{"kind": "error", "sampling": "some"}]}),
        refusal(stability={"poor_snapshots": {"bar": "some"}}),
        refusal(studies={"mode_pairs": {"samplings": {"bar": ["some"]}}}),
    ):
        assert said.startswith(f"scene bar: boundary = [fixed, free]: {DENSITY}")


def test_methods_are_refused_of_free_ends_by_name():
    settings = resolved()
    config.check_modes(settings, "bar", "some", "4", "lifted_exact")
    with pytest.raises(ConfigError, match=DENSITY):
        config.check_modes(settings, "bar", "some", "4", "frozen3")


def test_studies_of_samplings_leave_out_free_ends():
    settings = resolved()
    asked = [study.datasets["operators"] for study in studies().values() if "operators" in
             study.datasets]  # fmt: skip
    assert [list(data.places(settings)) for data in asked] == [[]]
    assert settings["stability"]["poor_snapshots"] == {}


def test_a_spectrum_is_of_a_periodic_line():
    said = refusal({"figures": [{"kind": "initial_spectrum"}]})
    assert said.endswith("initial_spectrum: a spectrum is drawn of a periodic line only")


def test_modes_are_lent_between_bars_of_the_same_ends():
    borrower = copy.deepcopy(BAR) | {"samplings": {"lent": {"modes": {"from": ["bar/some"]}}}}
    scenes = {"bar": copy.deepcopy(BAR), "other": borrower}
    config.load([], overrides={"scenes": scenes})
    for key, value, theirs in (
        ("boundary", ["free", "free"], "boundary of bar is [fixed, free]"),
        ("initial_density", 2, "initial_density of bar is 1"),
    ):
        changed = {"bar": copy.deepcopy(BAR), "other": copy.deepcopy(borrower) | {key: value}}
        with pytest.raises(ConfigError) as refused:
            config.load([], overrides={"scenes": changed})
        assert theirs in str(refused.value)


def test_a_periodic_boundary_is_as_none():
    periodic = {"boundary": "periodic", "initial_velocity": "1e-3*sin(2*pi*x)"}
    assert "boundary" not in resolved(periodic)["scenes"]["bar"]
