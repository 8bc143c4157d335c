"""Parameters that have a distribution: defaults, and one sentence for each fault."""

import pytest
from survey_cases import SCENE, settings

from sphpod.config.config import ConfigError, load

NORMAL = {"norm": {"loc": 0.5, "scale": 0.2}}


def with_decay(**given):
    return settings({"parameters": {**SCENE["parameters"], "decay": {"nominal": 0.5, **given}}})


def test_a_range_is_the_bounded_support_if_left_out() -> None:
    given = with_decay(distribution={"triang": {"c": 0.5, "loc": 0.2, "scale": 0.6}})
    assert load([], given)["scenes"]["bar"]["parameters"]["decay"]["range"] == [0.2, 0.8]


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({}, "decay.range = (missing): it must be given"),
        ({"distribution": NORMAL}, "as the support of the distribution, -inf to inf, has no ends"),
        ({"distribution": {"normal": {}}, "range": [0, 1]}, "did you mean norm?"),
        ({"distribution": {"poisson": {"mu": 1}}, "range": [0, 1]}, "no continuous distribution"),
        ({"distribution": {"norm": {"mean": 1}}, "range": [0, 1]}, "allowed are loc, scale"),
        ({"distribution": {"beta": {"a": 1}}}, "distribution.beta.b = (missing)"),
        ({"distribution": {"beta": {"a": -1, "b": 2}}}, "does not have such parameters"),
        ({"distribution": {"norm": {"scale": 0}}, "range": [0, 1]}, "not have such parameters"),
        ({"distribution": {"norm": {"loc": "high"}}, "range": [0, 1]}, "it must be a number"),
        ({"distribution": {"norm": 0.5}, "range": [0, 1]}, "it must be keys and values"),
        ({"distribution": "norm", "range": [0, 1]}, "it must be keys and values"),
        ({"distribution": {}, "range": [0, 1]}, "it must have at least 1 entry ("),
        ({"distribution": {**NORMAL, "cauchy": {}}, "range": [0, 1]}, "at most 1 entry ("),
        ({"distribution": {"uniform": {}}, "range": [0, 2]}, "support of the distribution, 0 to 1"),
        ({"distribution": {"norm": {"loc": 9}}, "range": [0, 1]}, "has a probability of"),
        ({"distribution": {"argus": {"chi": 1e-300}}}, "its values cannot be found"),
        ({"distribution": NORMAL, "range": [0, 1], "scale": "logarithmic"}, "says itself how"),
        ({"distribution": NORMAL, "range": [0, 0.4]}, "it must lie in the range 0 to 0.4"),
    ],
)
def test_a_fault_is_one_sentence(given, told) -> None:
    with pytest.raises(ConfigError) as caught:
        load([], with_decay(**given))
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"nominal": 1e308}, "decay.nominal = 1.0e+308: a size must be 0, or from 1e-140 to 1e"),
        ({"nominal": 1e-320}, "decay.nominal = 1.0e-320: a size must be 0, or from 1e-140 to 1e"),
        ({"range": [1e-321, 1]}, "decay.range = [1.0e-321, 1]: a size must be 0, or from 1e-140"),
        ({"range": [0, 1e200]}, "decay.range = [0, 1.0e+200]: a size must be 0, or from 1e-140"),
        ({"nominal": 1e100}, "decay.nominal = 1.0e+100: it must lie in the range 0 to 1"),
    ],
)
def test_a_size_that_is_none_is_that_of_the_parameter(changes, told) -> None:
    with pytest.raises(ConfigError) as caught:
        load([], with_decay(**{"nominal": 0.5, "range": [0, 1], **changes}))
    assert f"scene bar: parameters.{told}" in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("damping", "sum(l for l in range(1, decay))", "damping = sum(l for l in range(1, decay)"),
        (
            "force",
            ["t", {"time": "sum(t*l for l in range(decay))", "profile": "x"}],
            "force.1.time",
        ),
    ],
)
def test_a_sum_does_not_run_up_to_a_parameter(key, value, told) -> None:
    parameters = {**SCENE["parameters"], "decay": {"nominal": 4, "range": [2, 8]}}
    with pytest.raises(ConfigError) as caught:
        load([], settings({"parameters": parameters, key: value}))
    assert f"scene bar: {told}" in str(caught.value)
    assert "holds the parameter decay, which is any number from 2 to 8" in str(caught.value)
