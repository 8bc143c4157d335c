"""Modes of the snapshots of other samplings, borrowed only between the same particles."""

import pytest
import scenes

from sphpod.config import config

WAVE = scenes.settings(
    samplings={
        "uniform10": {"range": [0, 1], "count": 10},
        "few": {"velocity_times": [0, 0.5], "density_times": [0, 0.5, 0.9]},
    }
)


def loaded(settings):
    return config.load([], settings)


def borrowing(*sources, **changes):
    other = WAVE | {"initial_velocity": "1e-3*sin(4*pi*x/L)", "samplings": {}} | changes
    return {
        "scenes": {
            "wave": WAVE,
            "other": other | {"samplings": {"lent": {"modes": {"from": list(sources)}}}},
        }
    }


def test_borrowed_modes_are_as_many_as_the_snapshots_of_all_their_samplings():
    few = loaded(borrowing("wave/few"))["scenes"]
    both = loaded(borrowing("wave/few", "wave/uniform10"))["scenes"]["other"]["samplings"]["lent"]
    own = few["wave"]["samplings"]
    assert few["other"]["samplings"]["lent"]["mode_counts"] == own["few"]["mode_counts"]
    assert both["counts"] == [2 + 10, 3 + 10]


@pytest.mark.parametrize(
    ("sources", "changes", "answer"),
    [
        (["wave/fw"], {}, "other: samplings.lent.modes.from = wave/fw: no such sampling with"),
        (["other/lent"], {}, "no such sampling with snapshots of its own; allowed are wave/"),
        (["wave"], {}, "modes.from = wave: no such sampling with snapshots of its own"),
        (["wave/few"], {"particle_count": 50}, "particle_count of wave is"),
        (["wave/few"], {"domain_length": 2}, "domain_length of wave is 1"),
        (["wave/few"], {"positions": {"jitter": 0.1}}, "positions of wave is evenly spaced"),
        ([], {}, "samplings.lent.modes.from = []: it must have at least 1"),
    ],
)
def test_modes_that_cannot_be_borrowed_are_refused(sources, changes, answer):
    with pytest.raises(config.ConfigError) as caught:
        loaded(borrowing(*sources, **changes))
    assert answer in str(caught.value)
    assert "\n" not in str(caught.value)


SPELLINGS = [
    ({}, {"positions": {"jitter": 0, "seed": 7}}),
    ({"positions": {"jitter": 0.1}}, {"positions": {"jitter": 0.1, "seed": 0}}),
    ({}, {"boundary": "periodic", "domain_length": 1.0, "particle_count": 4e1}),
    ({"domain_length": 0.3}, {"domain_length": 0.30000000000000004}),
    (
        {"boundary": ["fixed", "free"], "initial_velocity": 0, "initial_density": 1.5},
        {"boundary": ["fixed", "free"], "initial_velocity": 0, "initial_density": "3/2"},
    ),
]


@pytest.mark.parametrize(("lender", "borrower"), SPELLINGS)
def test_two_spellings_of_one_line_are_one(lender, borrower):
    settings = borrowing("wave/few", **lender | borrower)
    settings["scenes"]["wave"] = WAVE | lender
    assert loaded(settings)["scenes"]["other"]["samplings"]["lent"]["counts"] == [2, 3]


@pytest.mark.parametrize(
    ("lender", "borrower", "answer"),
    [
        ({"positions": {"jitter": 0.1}}, {"positions": {"jitter": 0.1, "seed": 1}}, "positions"),
        ({"positions": {"jitter": 0.1}}, {"positions": {"jitter": 0}}, "positions"),
        ({"boundary": ["fixed", "fixed"], "initial_velocity": 0}, {}, "boundary"),
        (
            {"boundary": ["free", "free"]},
            {"boundary": ["free", "free"], "initial_density": "1 + 0.1*cos(pi*x/L)"},
            "initial_density",
        ),
    ],
)
def test_different_lines_are_refused(lender, borrower, answer):
    settings = borrowing("wave/few", **borrower)
    settings["scenes"]["wave"] = WAVE | lender
    with pytest.raises(config.ConfigError, match=f"same particles only, and {answer} of wave is"):
        loaded(settings)
