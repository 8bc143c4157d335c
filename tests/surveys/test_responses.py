"""Sections and surfaces: where they lie, and that single queries give the same."""

import numpy as np
import pytest
from survey_cases import settings

from sphpod.config.config import load
from sphpod.surveys import responses, training
from sphpod.surveys.loaded import LoadedSurvey

QUANTITIES = {
    "sensor": {"kind": "history", "place": 0.3},
    "energy": {"kind": "energy"},
    "peak": {"kind": "maximum", "field": "strain", "place": 0.3},
}


@pytest.fixture(scope="module")
def made():
    resolved = load([], settings(training={"count": 3}, mode_count=6, quantities=QUANTITIES))
    physics, survey = resolved["scenes"]["bar"], resolved["surveys"]["graded"]
    # How likely a value is does not matter to where it is shown.
    physics["parameters"]["decay"]["distribution"] = {"norm": {"loc": 0.5, "scale": 0.1}}
    runs = [training.run("bar", physics, survey, n) for n in range(3)]
    model = training.train("bar", physics, survey, runs)
    return physics, survey, model, responses.sections("bar", physics, survey, model)


def test_a_section_runs_evenly_along_one_parameter_alone(made) -> None:
    physics, _, _, found = made
    assert "sensor" not in found
    for n, (word, given) in enumerate(physics["parameters"].items()):
        part = slice(n * responses.ALONG, (n + 1) * responses.ALONG)
        values = found[word][part]
        np.testing.assert_allclose(values[[0, -1]], given["range"], rtol=1e-12)
        even = np.log(values) if given["scale"] == "logarithmic" else values
        np.testing.assert_allclose(np.diff(even), np.diff(even)[0], rtol=1e-9)
        for other in {*physics["parameters"]} - {word}:
            assert np.all(found[other][part] == physics["parameters"][other]["nominal"])


def test_a_surface_is_over_the_parameters_that_a_quantity_depends_on(made) -> None:
    physics, survey, model, sections = made
    found = responses.surfaces("bar", physics, survey, model, sections)
    assert found["quantity"].tolist() == ["energy", "peak"]
    size = responses.ACROSS**2
    block = found["surface"][1]
    part = slice(block * size, (block + 1) * size)
    spans = {
        word: np.ptp(sections["peak"][n * responses.ALONG : (n + 1) * responses.ALONG])
        for n, word in enumerate(physics["parameters"])
    }
    weakest = min(spans, key=spans.__getitem__)
    assert {word for word in spans if np.ptp(found[word][part]) == 0} == {weakest}
    loaded = LoadedSurvey({"scene": "bar", "physics": physics, "survey": survey}, model)
    at = part.start + 37
    one = loaded(**{word: found[word][at] for word in physics["parameters"]})
    assert float(one["peak"]) == pytest.approx(found["peak"][at], rel=1e-12)
