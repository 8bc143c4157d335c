"""Checks of a scene take no more work for more particles, and refuse what is seen at few times."""

import pytest
from scenes import scene

from sphpod.numerics.expressions import Expression
from sphpod.scene import checks

FRONT = "where(cos(2*pi*x/L - 3*t) > 0, 1, 0)"


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [{"youngs_modulus": f"0.1*(1 + 0.5*{FRONT})"}, {"damping": FRONT}, {"force": FRONT}],
    ids=lambda changes: next(iter(changes)),
)
def test_a_front_is_checked_at_a_cost_that_particles_do_not_raise(changes, monkeypatch):
    calls: list[str] = []
    evaluated = Expression._evaluated

    def counted(self, *given):
        calls.append(self.text)
        return evaluated(self, *given)

    monkeypatch.setattr(Expression, "_evaluated", counted)

    def cost(count):
        calls.clear()
        checks.check(scene(**changes, particle_count=count, time_step=1e-6, error_interval=0.01))
        return len(calls)

    assert cost(4000) < 2 * cost(200)


def test_a_pulse_in_which_a_modulus_is_negative_is_found_wherever_it_travels():
    pulse = "0.1*(1 - 2*where(abs(t - 0.2345678 - 0.1*x) < 1e-9, 1, 0))"
    with pytest.raises(ValueError, match=r"youngs_modulus = .* must be positive everywhere"):
        checks.check_setting(scene(youngs_modulus=pulse, particle_count=400))


@pytest.mark.parametrize(
    ("force", "key"),
    [
        ({"time": "1/t", "profile": "x"}, "force.time = 1/t"),
        (["t", {"time": "1/t", "profile": "x"}], "force.1.time = 1/t"),
        (["t", {"time": "t", "profile": "1/x"}], "force.1.profile = 1/x"),
        (["t", "1/t"], "force.1 = 1/t"),
        ("1/t", "force = 1/t"),
    ],
)
def test_a_fault_of_a_force_is_named_by_its_own_key(force, key):
    with pytest.raises(ValueError, match=r"it is not finite at") as caught:
        checks.check_setting(scene(force=force))
    assert key in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"youngs_modulus": "1 + 1e-4*sum(sin(2*pi*k*x) for k in range(1, 1001))"}, "1001"),
        ({"damping": f"1 + {FRONT}"}, "where"),
    ],
)
def test_many_scenes_are_checked_for_what_a_few_take(changes, key, monkeypatch):
    """Each of forty is looked at in fewer places than one alone."""
    values: list[int] = []
    evaluated = Expression._evaluated

    def counted(self, steps, given):
        found = evaluated(self, steps, given)
        values.append(found.size * getattr(self, "terms", 1) if key in self.text else 0)
        return found

    monkeypatch.setattr(Expression, "_evaluated", counted)

    def cost(share):
        values.clear()
        one = scene(**changes, particle_count=4000, time_step=1e-6, error_interval=0.01)
        checks.check(one, share)
        return sum(values)

    assert 40 * cost(1 / 40) < 2 * cost(1)


def test_a_fault_that_a_share_of_the_work_has_not_met_is_met_by_the_run():
    narrow = scene(particle_count=4000, youngs_modulus="1 - 2*where(abs(x - 0.50025) < 1e-9, 1, 0)")
    checks.check_setting(narrow, 1e-4)
    with pytest.raises(
        ValueError, match=r"it is -1 at x = 0.50025 and must be positive everywhere"
    ):
        narrow.modulus()
