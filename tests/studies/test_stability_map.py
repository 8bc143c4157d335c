"""Maps of where runs grow, beside those that theory predicts."""

import numpy as np
import pytest
from scenes import scene
from test_time_steps import KINDS, THREE_WAVES, decomposed, fits_dataset

from sphpod.reduced import lifted_rom
from sphpod.stability.spectrum import FullSpectrum
from sphpod.studies import stability_map


@pytest.mark.parametrize("kind", ["plain", "damped"])
def test_a_map_over_damping_shows_the_spectral_radius(kind, tmp_path):
    case = scene(particle_count=16, **KINDS[kind])
    arrays = stability_map.of_damping(case, 7)
    assert fits_dataset(arrays, tmp_path / "map.nc", stability_map.STUDY.variables)
    for n, integrator in enumerate(arrays["map_integrator"]):
        for m, damping in enumerate(arrays["map_damping"]):
            whole = FullSpectrum(scene(particle_count=16, damping=float(damping))).whole
            for t, time_step in enumerate(arrays["map_time_step"]):
                step = whole.step(str(integrator), time_step)
                largest = np.log(np.abs(np.linalg.eigvals(step)).max())
                assert arrays["map_growth"][n, m, t] == pytest.approx(largest, 1e-2, 2e-3)
                if abs(time_step / arrays["map_limit"][n, m] - 1) > 1e-6:
                    assert (time_step > arrays["map_limit"][n, m]) == (largest > 1e-9)


@pytest.mark.parametrize("kind", ["plain", "damped"])
def test_a_map_over_modes_shows_the_spectral_radius(kind, tmp_path):
    case = scene(initial_velocity=THREE_WAVES, **KINDS[kind])
    modes, energy_modes = decomposed(case)
    arrays = stability_map.of_modes(case, [4, 9], modes, energy_modes, 8)
    assert fits_dataset(arrays, tmp_path / "map.nc", stability_map.STUDY.variables)
    assert arrays["contender"].tolist() == ["original", "lifted_euler"]
    assert np.isnan(arrays["mode_limit"]).all() == (kind == "plain")
    for n, count in enumerate(arrays["mode_count"]):
        model = lifted_rom.build(case, energy_modes, count)
        for t, time_step in enumerate(arrays["map_time_step"]):
            step = np.eye(len(model.operator)) + time_step * model.operator
            largest = np.log(np.abs(np.linalg.eigvals(step)).max())
            assert arrays["mode_growth"][1, n, t] == pytest.approx(largest, abs=5e-3)
    beyond = arrays["map_time_step"] > 1.3 * arrays["mode_limit"][..., None]
    within = arrays["map_time_step"] < arrays["mode_limit"][..., None] / 1.1
    assert (arrays["mode_growth"][beyond] > 0).all()
    assert (arrays["mode_growth"][within] < 2e-3).all()
