"""Parameters with a distribution: everything that is drawn follows it, cut at the range."""

import numpy as np
import pytest
from scipy import stats
from survey_cases import SCENE, settings

from sphpod.config.config import load
from sphpod.surveys import distributions, samples, sensitivity, training, validation
from sphpod.surveys.loaded import LoadedSurvey

NORMAL = {"nominal": 0.5, "range": [0, 1], "distribution": {"norm": {"loc": 0.6, "scale": 0.2}}}
CUT = stats.truncnorm(-3, 2, loc=0.6, scale=0.2)
RANGES = {**SCENE["parameters"], "decay": NORMAL}


@pytest.mark.parametrize("sampling", ["sobol", "halton", "latin_hypercube", "uniform"])
def test_queries_have_the_distribution_that_is_cut(sampling) -> None:
    drawn = samples.points(RANGES, {"count": 4096, "sampling": sampling})[:, 2]
    assert stats.kstest(drawn, CUT.cdf).pvalue > 1e-3
    assert drawn.min() >= 0
    assert drawn.max() <= 1


def test_a_grid_has_even_steps_of_probability() -> None:
    values = samples.points(RANGES, {"grid": {"decay": 5}})[:, 2]
    assert values[[0, -1]].tolist() == [0, 1]
    np.testing.assert_allclose(CUT.cdf(values), [0, 0.25, 0.5, 0.75, 1], atol=1e-12)


def test_corners_are_ends_of_the_range_even_where_nothing_is_likely() -> None:
    narrow = {"decay": NORMAL | {"distribution": {"norm": {"loc": 0.5, "scale": 1e-3}}}}
    assert samples.corners(narrow).ravel().tolist() == [0, 1]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_range_far_out_in_a_tail_keeps_its_digits(sign) -> None:
    ends = sorted([7 * sign, 9 * sign])
    shares = np.linspace(0, 1, 9)
    found = distributions.spread({"distribution": {"norm": {}}, "range": ends}, shares)
    expected = stats.truncnorm(*ends).ppf(shares)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_every_distribution_that_is_known_is_spread_over_its_range() -> None:
    plain = [name for name in distributions.names() if not distributions.keys(name)[0]]
    assert {"norm", "uniform", "gumbel_r"} <= {*plain}
    for name in plain:
        low, high = np.clip(stats.distributions.__dict__[name].support(), -1, 3)
        given = {"distribution": {name: {}}, "range": [low, high]}
        values = distributions.spread(given, np.linspace(0, 1, 9))
        assert np.all(np.diff(values) >= 0), name
        assert values[0] == low, name
        assert values[-1] == high, name


def trained(distribution):
    of_scene = {"parameters": RANGES | {"decay": NORMAL | {"distribution": distribution}}}
    quantities = {"energy": {"kind": "energy"}}
    resolved = load([], settings(of_scene, quantities=quantities, sobol_samples=64))
    physics, survey = resolved["scenes"]["bar"], resolved["surveys"]["graded"]
    runs = [training.run("bar", physics, survey, n) for n in range(survey["training"]["count"])]
    return physics, survey, training.train("bar", physics, survey, runs), runs


@pytest.fixture(scope="module")
def narrow():
    return trained({"norm": {"loc": 0.5, "scale": 1e-3}})


def test_training_and_validation_are_where_the_distribution_is(narrow) -> None:
    physics, survey, model, runs = narrow
    assert all(abs(run["point"][2] - 0.5) < 6e-3 for run in runs)
    found = validation.validate("bar", physics, survey, model)
    assert np.all(np.abs(found["decay"] - 0.5) < 6e-3)
    assert found["inside"].all()


def test_a_parameter_that_hardly_varies_has_no_share_of_the_variance(narrow) -> None:
    physics, survey, model, _ = narrow
    shares = sensitivity.share_out("bar", physics, survey, model)
    total = dict(zip(shares["parameter"], shares["total_index"][0], strict=True))
    # Spread evenly over the same range, damping makes four fifths of it.
    assert total["decay"] < 0.01


def test_a_loaded_survey_refuses_what_is_outside_the_range(narrow) -> None:
    physics, survey, model, _ = narrow
    loaded = LoadedSurvey({"scene": "bar", "physics": physics, "survey": survey}, model)
    with pytest.raises(ValueError, match=r"decay = 1.5 is outside its range 0 to 1"):
        loaded(decay=1.5)
    assert float(loaded(decay=1.5, extrapolate=True)["energy"]) > 0
