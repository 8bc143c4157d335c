"""Whatever the model, a run is run, looked at and shown in one way."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import VARIED, scene

from sphpod.full import lifted, sph
from sphpod.reduced import lifted_rom, rom
from sphpod.reduced.pod import decompose
from sphpod.scene.breakdown import Breakdown

REDUCED = ("original", "linearized", "frozen10", *lifted_rom.METHODS)
MODELS = ("stencil", "lists", *lifted.INTEGRATORS, *REDUCED)
each = pytest.mark.parametrize("model", MODELS)


def prepare(case, model, start=None, source=None):
    """A model, on six modes of another scene."""
    if model in ("stencil", "lists"):
        return sph.prepare(case, case.error_steps, model, start)
    if model in lifted.INTEGRATORS:
        return lifted.prepare(case, model, start=start)
    source = source or scene(**VARIED)
    full = sph.solve(source, source.error_steps)
    taken = {f"{field}_snapshots": full[field][::5] for field in ("velocity", "density")}
    if model in lifted_rom.METHODS:
        return lifted_rom.build(case, lifted_rom.decompose(case, taken), 6).prepare(model, start)
    taken["x"] = case.positions
    return rom.galerkin(case, model, decompose(taken), 6).prepare(case.error_steps, start)


@each
def test_some_outputs_are_rows_of_all(model):
    run = prepare(scene(**VARIED), model).solve()
    whole = run.fields()
    assert list(whole) in (["velocity", "density"], ["velocity", "strain"])
    for rows in (slice(0, 1), slice(40, 60), slice(-1, None)):
        for name, some in run.fields(rows).items():
            scale = np.abs(whole[name]).max()
            np.testing.assert_allclose(some, whole[name][rows], rtol=0, atol=1e-14 * scale)
    np.testing.assert_array_equal(run.stored()["t"], run.times)
    assert whole["velocity"].shape == (run.times.size, run.scene.particle_count)


@each
def test_a_run_is_run_again_in_other_arrays(model):
    run = prepare(scene(**VARIED, duration=0.2), model).run()
    first = run.state
    run.state = tuple(np.zeros_like(array) for array in first)
    assert run.run().breakdown() is None
    for array, again in zip(first, run.state, strict=True):
        np.testing.assert_array_equal(array, again)


@each
def test_what_solve_raises_is_how_it_broke_down(model):
    strong = scene("crash", **(VARIED | {"initial_velocity": "0.9*sin(2*pi*x/L)"}))
    run = prepare(strong, model)
    with pytest.raises(Breakdown, match="scene crash: ") as caught:
        run.solve()
    broken = run.run().breakdown()
    assert broken is not None
    assert (broken.time, broken.particle) == (caught.value.time, caught.value.particle)
    assert broken.time in run.times


@pytest.mark.parametrize("model", ["frozen10", *lifted_rom.METHODS])
def test_between_outputs_a_run_is_looked_at_from_its_own_start(model):
    """A wave that is back at the only output folds on the way where it is given twice as strong."""
    case = scene(
        duration=3.2, error_interval=3.2, youngs_modulus=0.09765625,
        initial_velocity="0.2*sin(2*pi*x/L)",
    )  # fmt: skip
    often = replace(case, error_interval=0.02)
    run = prepare(case, model, source=often).solve()
    state = run.coordinates() if isinstance(run, lifted_rom.LiftedRun) else run.state
    velocity, second = (coordinates[0] for coordinates in state)
    broken = prepare(case, model, (2 * velocity, second), often).run().breakdown()
    assert broken is not None
    assert 0 < broken.time < 3.2
