"""What a run uses is looked at where it is used, however few places and times a check has seen."""

import re
from typing import Any

import pytest
from scenes import scene

from sphpod.full import lifted, sph
from sphpod.reference import chain, reference
from sphpod.scene.breakdown import Breakdown

INSTANT = 0.234
"""A time of a step, at which nothing else happens."""

NARROW = f"where((abs(x - 0.325) < 1e-4) and (abs(t - {INSTANT}) < 1e-9), 1, 0)"
BRIEF = f"where(abs(t - {INSTANT}) < 1e-9, 1, 0)"
PLACE = "where(abs(x - 0.325) < 1e-9, 1, 0)"

FAULTS: dict[str, tuple[dict[str, Any], str, str]] = {
    "modulus, narrow and brief": (
        {"youngs_modulus": f"0.1*(1 - 2*{NARROW})"},
        "youngs_modulus",
        f"it is -0.1 at x = 0.325, t = {INSTANT} and must be positive everywhere",
    ),
    "modulus, brief": (
        {"youngs_modulus": f"0.1*(1 - 2*{BRIEF}*sin(2*pi*x)**2)"},
        "youngs_modulus",
        f"it is -0.1 at x = 0.25, t = {INSTANT} and must be positive everywhere",
    ),
    "modulus, of a root": (
        {"youngs_modulus": f"0.1 + 0*sqrt(abs(t - {INSTANT}) - 1e-9)"},
        "youngs_modulus",
        f"it is not finite at x = 0, t = {INSTANT}",
    ),
    "damping": (
        {"damping": f"1 - 2*{NARROW}"},
        "damping",
        f"it is -1 at x = 0.325, t = {INSTANT} and must not be negative",
    ),
    "damping that is no number": (
        {"damping": f"1/(1 - {BRIEF})"},
        "damping",
        f"it is not finite at x = 0, t = {INSTANT}",
    ),
    "force": (
        {"force": f"1e-3/(1 - {NARROW})"},
        "force",
        f"it is not finite at x = 0.325, t = {INSTANT}",
    ),
    "profile of a force": (
        {"force": {"time": "t", "profile": f"1/(1 - {PLACE})"}},
        "force.profile",
        "it is not finite at x = 0.325",
    ),
    "velocity": (
        {"initial_velocity": f"1/(1 - {PLACE})"},
        "initial_velocity",
        "it is not finite at x = 0.325",
    ),
    "density": (
        {"initial_density": f"1 - 2*{PLACE}"},
        "initial_density",
        "it is -1 at x = 0.325 and must be positive everywhere",
    ),
}
"""Settings, the key that is named, and what is said of it."""

MODELS = {
    "full SPH": lambda one: sph.solve(one, one.error_steps),
    "lifted, explicit Euler": lambda one: lifted.solve(one, "explicit_euler"),
    "lifted, leapfrog": lambda one: lifted.solve(one, "leapfrog"),
    "lifted, exact": lambda one: lifted.solve(one, "exact"),
    "finite differences": reference.solve_paper,
    "centred differences": reference.solve_centred,
    "chain": chain.solve,
}
UNMET = {("modulus, of a root", "lifted, exact")}
"""A fault at a time that a model does not use: it looks within pieces."""


@pytest.mark.parametrize(
    ("fault", "model"), sorted({(fault, model) for fault in FAULTS for model in MODELS} - UNMET)
)
def test_what_is_used_and_none_is_refused(fault, model):
    changes, key, told = FAULTS[fault]
    given = scene(**changes, name="wave")
    with pytest.raises(
        ValueError, match=rf"^scene wave: {re.escape(key)} = .*: {re.escape(told)}$"
    ):
        MODELS[model](given)


@pytest.mark.parametrize("model", sorted(set(MODELS) - {"lifted, leapfrog"}))
def test_a_course_of_a_force_that_is_none_ends_a_run_at_the_next_output(model):
    """Leapfrog looks at it between the steps."""
    course = {"time": f"1e-3/(1 - {BRIEF})", "profile": "sin(2*pi*x)"}
    with pytest.raises(Breakdown, match=r"^scene wave: .* broke down by t = 0.24 s"):
        MODELS[model](scene(force=["t", course], name="wave"))


def test_what_happens_at_one_particle_is_no_less_followed():
    """At one of many places, and briefly, a modulus is another; a sum of products has it."""
    given = scene(particle_count=400, youngs_modulus=f"0.1*(1 + {NARROW.replace('1e-9', '2e-4')})")
    changing = given.changing("youngs_modulus")
    assert changing.at([INSTANT])[0, 130] == pytest.approx(0.2, rel=1e-12)
