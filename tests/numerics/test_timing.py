"""Times are taken in turns, of a machine that is named."""

from sphpod.numerics import timing


def test_contenders_take_turns():
    calls = []
    timing.measure([lambda: calls.append("a"), lambda: calls.append("b")], 3)
    assert calls == ["a", "b"] * 3


def test_the_machine_is_named():
    described = timing.machine()
    assert described["processor"]
    assert described["blas_threads"] == 1
