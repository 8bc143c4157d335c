"""Files of bars with ends hold the bar alone, and give the line again."""

import numpy as np
import pytest
import scenes
import xarray as xr

import sphpod
from sphpod.bar import of_bar, of_line
from sphpod.full import lifted, sph
from sphpod.pipeline import dataset
from sphpod.reduced import lifted_rom, pod, snapshots

WAVES = {
    ("fixed", "fixed"): "sin(pi*x) + sin(2*pi*x)/2",
    ("free", "free"): "cos(pi*x) + cos(2*pi*x)/2",
    ("fixed", "free"): "sin(pi*x/2) + sin(3*pi*x/2)/2",
}


def bar(boundary, **changes):
    wave = f"1e-3*({WAVES[boundary]})"
    usual = {
        "boundary": list(boundary),
        "particle_count": 31,
        "initial_velocity": wave,
        "initial_density": "1 + x/4",
    }
    return scenes.scene(**usual | changes)


def solved(scene):
    """Arrays of all kinds that files hold: fields, snapshots, modes and coordinates."""
    full, strains = sph.solve(scene, scene.error_steps), lifted.solve(scene, "exact")
    taken = snapshots.extract(scene, {"range": [0, 1], "count": 4}, full)
    model = lifted_rom.build(scene, lifted_rom.decompose(scene, taken), 2)
    return {
        **full,
        "strain": strains["strain"],
        **taken,
        **pod.decompose(taken),
        **lifted_rom.decompose(scene, taken),
        **model.prepare("lifted_exact").solve().stored(),
    }


@pytest.mark.parametrize("boundary", WAVES)
def test_the_line_comes_again(boundary):
    scene = bar(boundary)
    arrays = solved(scene)
    again = of_line(scene, of_bar(scene, arrays))
    assert list(again) == list(arrays)
    for name, values in arrays.items():
        if name == "density_modes" and "free" in boundary:
            continue  # No model of free ends has modes of density.
        size = np.abs(values).max(initial=0) or 1.0
        np.testing.assert_allclose(again[name], values, atol=1e-9 * size, rtol=0, err_msg=name)


@pytest.mark.parametrize("boundary", WAVES)
def test_files_hold_the_bar_alone(boundary):
    scene = bar(boundary)
    for name, values in of_bar(scene, solved(scene)).items():
        if name in ("x", "velocity", "density", "strain") or name.endswith(("modes", "output")):
            assert values.shape[-1] == 31, name


@pytest.mark.parametrize("boundary", WAVES)
def test_modes_of_a_file_are_orthonormal_with_half_of_the_ends(boundary):
    scene = bar(boundary)
    weights = np.ones(31)
    weights[[0, -1]] = 0.5
    arrays = of_bar(scene, solved(scene))
    for name in ("velocity_modes", "scaled_velocity_modes", "scaled_strain_modes"):
        modes = arrays[name]
        np.testing.assert_allclose((modes * weights) @ modes.T, np.eye(len(modes)), atol=1e-9)


@pytest.mark.parametrize("boundary", WAVES)
def test_coordinates_of_a_file_hold_the_energy_of_the_bar(boundary):
    scene = bar(boundary)
    taken = sphpod.take_snapshots(scene, range=[0, 1], count=3)
    modes = sphpod.decompose_lifted(scene, taken)
    reduced = sphpod.solve_reduced(scene, "lifted_exact", modes, 2)
    energy = lifted.energy_weights(scene)[0][:31]
    norms = np.linalg.norm(reduced.scaled_velocity_coordinates.values, axis=1)
    weights = np.ones(31)
    weights[[0, -1]] = 0.5
    of_fields = np.sqrt(((energy * reduced.velocity.values) ** 2) @ weights)
    np.testing.assert_allclose(norms, of_fields, atol=1e-9 * of_fields.max())


@pytest.mark.parametrize("boundary", WAVES)
def test_public_functions_give_the_bar(boundary):
    scene = bar(boundary)
    full = sphpod.solve_sph(scene)
    assert full.sizes == {"t": scene.error_times.size, "x": 31}
    assert full.attrs["boundary"] == f"[{boundary[0]}, {boundary[1]}]"
    np.testing.assert_allclose(full.x, np.linspace(0, 1, 31), atol=1e-15)
    exact = sphpod.solve_lifted(scene)
    taken = sphpod.take_snapshots(scene, range=[0, 1], count=4)
    modes = sphpod.decompose_lifted(scene, taken)
    found = sphpod.sweep(scene, "lifted_exact", [2, 4], modes, exact, exact)
    assert found.velocity_error_lifted[1] < 0.1 * found.velocity_error_lifted[0]
    assert (found.energy_error_bound >= found.energy_error_lifted).all()
    compared = sphpod.compare(scene, full, {"centred": sphpod.solve_reference(scene, "centred")})
    assert compared.velocity_error[0, 0] < 0.05
    assert len(sphpod.plot_profile(scene, full).axes) >= 2


def test_the_papers_models_of_fixed_ends_follow_full_sph():
    scene = bar(("fixed", "fixed"))
    full = sphpod.solve_sph(scene)
    taken = sphpod.take_snapshots(scene, range=[0, 1], count=20)
    with pytest.raises(ValueError, match=r"bar with ends \[fixed, fixed\]: its scene must be"):
        sphpod.decompose(taken)
    modes = sphpod.decompose(taken, scene)
    for method in ("original", "linearized", "frozen3"):
        reduced = sphpod.solve_reduced(scene, method, modes, 12)
        assert sphpod.relative_error(reduced.velocity, full.velocity) < 1e-2
        assert not np.abs(reduced.velocity[:, [0, -1]]).max() > 1e-12
    sphpod.plot_modes(scene, modes)


def test_a_file_of_ones_own_is_of_the_bar(tmp_path):
    scene = bar(("fixed", "free"))
    full = sphpod.solve_sph(scene)
    path = tmp_path / "mine.nc"
    xr.Dataset({"velocity": full.velocity, "density": full.density}).to_netcdf(path)
    found = of_line(scene, of_bar(scene, snapshots.own(scene, {"from": str(path)})))
    assert found["velocity_snapshots"].shape == (full.t.size, scene.particle_count)
    np.testing.assert_allclose(found["velocity_snapshots"][:, :31], full.velocity)


def test_energies_are_of_the_bar():
    scene = bar(("fixed", "free"))
    meaning = {"an_energy": dataset.Variable(("t",), "J m-2", "an energy")}
    found = of_bar(scene, {"an_energy": np.ones(2), "contender": np.array(["one"])}, meaning)
    assert found["an_energy"].tolist() == [0.25, 0.25]
    assert found["contender"].tolist() == ["one"]


def test_a_bar_that_stays_at_rest_has_no_mode_of_strain():
    scene = bar(("fixed", "free"), initial_velocity=0)
    taken = sphpod.take_snapshots(scene, range=[0, 1], count=4)
    modes = sphpod.decompose_lifted(scene, taken)
    assert not sphpod.solve_reduced(scene, "lifted_exact", modes, 1).velocity.any()


def test_a_scene_without_ends_is_left_alone():
    scene = scenes.scene()
    arrays = {"x": scene.positions, "velocity": np.zeros((2, 40))}
    assert of_bar(scene, arrays) is arrays
    assert of_line(scene, arrays)["velocity"] is arrays["velocity"]
