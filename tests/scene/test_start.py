"""Scenes that start from a state that a file of another run holds."""

import pickle
from typing import Any

import netCDF4
import numpy as np
import pytest
import scenes

from sphpod import solve_lifted, solve_reference, solve_sph
from sphpod.config.config import ConfigError
from sphpod.config.configured import make_scene
from sphpod.full import lifted, sph
from sphpod.reduced import error_bound, lifted_rom, rom, rounding, snapshots
from sphpod.reduced.pod import decompose
from sphpod.reference import reference
from sphpod.scene import waves
from sphpod.scene.scene import Scene

SAMPLING = {"range": [0, 0.5], "count": 25}
KINDS: dict[str, dict[str, Any]] = {
    "periodic": scenes.VARIED | {"force": 1e-3, "initial_velocity": "1e-2*sin(2*pi*x/L)"},
    "changing": {"damping": "0.3*(1 + sin(2*pi*x/L))", "youngs_modulus": "0.1*(1 + x*(L - x))"},
    "bar": {
        "boundary": ["fixed", "free"],
        "particle_count": 21,
        "initial_velocity": "1e-2*sin(3*pi*x/2/L)",
        "damping": 0.2,
    },
    "jittered": {"positions": {"jitter": 0.2, "seed": 3}},
}


def whole(kind, folder):
    """A scene over one second, and its solutions of both full models, in files."""
    scene = make_scene("whole", **scenes.settings(**KINDS[kind]))
    full = {"sph": solve_sph(scene), "lifted": solve_lifted(scene)}
    for name, solution in full.items():
        # Of the lifted model only what the workflow keeps.
        solution.drop_vars("density" if name == "lifted" else []).to_netcdf(folder / f"{name}.nc")
    return full


def rest(kind, path, **changes):
    """The second half of it, from the file."""
    settings = scenes.settings(**KINDS[kind] | {"duration": 0.5} | changes)
    del settings["initial_velocity"]
    return make_scene("rest", start={"from": str(path), "t": 0.5}, **settings)


@pytest.mark.parametrize("kind", KINDS)
def test_a_run_in_two_parts_is_that_in_one(kind, tmp_path):
    """To rounding: the stress is stepped on, but begins from the density in the second part."""
    full = whole(kind, tmp_path)
    solved = {"sph": solve_sph, "lifted": solve_lifted}
    for name, fields in (("sph", ("velocity", "density")), ("lifted", ("velocity", "strain"))):
        scene = rest(kind, tmp_path / f"{name}.nc")
        found = solved[name](scene)
        for field in fields:
            expected = full[name][field].values[-scene.error_times.size :]
            size = np.abs(expected).max()
            np.testing.assert_allclose(found[field], expected, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("kind", KINDS)
def test_reduced_models_start_there_and_are_bounded(kind, tmp_path):
    whole(kind, tmp_path)
    scene = rest(kind, tmp_path / "lifted.nc")
    taken = snapshots.extract(scene, SAMPLING, _sph(scene))
    modes = lifted_rom.decompose(scene, taken)
    full = lifted.solve(scene, "exact")
    mass, stiffness = lifted.energy_weights(scene)
    size = np.hypot(
        np.linalg.norm(mass * full["velocity"], axis=1),
        np.linalg.norm(stiffness * full["strain"], axis=1),
    ).max()
    for count in (4, 10):
        run = lifted_rom.build(scene, modes, count).prepare("lifted_exact").solve()
        found = run.fields()
        error = np.hypot(
            np.linalg.norm(mass * (found["velocity"] - full["velocity"]), axis=1),
            np.linalg.norm(stiffness * (found["strain"] - full["strain"]), axis=1),
        )
        bound, _ = error_bound.error_bounds(run)
        assert (error <= bound + 1e-12 * size).all()
        assert error[0] < 0.9 * size, "the model starts unstrained"
    if kind != "bar":
        model = rom.model(scene, "original", decompose(taken), 20)
        found, again = model.prepare(scene.error_steps).solve().fields(), _sph(scene)
        moved = np.linalg.norm(again["velocity"])
        assert np.linalg.norm(found["velocity"] - again["velocity"]) < 1e-3 * moved
        assert np.linalg.norm(found["density"][0] - again["density"][0]) < 1e-6


def _sph(scene):
    return sph.solve(scene, snapshots.output_steps(scene, [SAMPLING]))


def test_a_changing_modulus_keeps_the_bound_of_a_strained_start(tmp_path):
    whole("changing", tmp_path)
    scene = rest("changing", tmp_path / "sph.nc", youngs_modulus="0.1*(1 + 0.3*sin(x + 3*t))")
    modes = lifted_rom.decompose(scene, snapshots.extract(scene, SAMPLING, _sph(scene)))
    run = lifted_rom.build(scene, modes, 3).prepare("lifted_exact").solve()
    found = run.fields()
    full, (mass, stiffness) = lifted.solve(scene, "exact"), lifted.energy_weights(scene)
    bound, _ = error_bound.error_bounds(run)
    begun = np.hypot(
        np.linalg.norm(mass * (found["velocity"] - full["velocity"])[0]),
        np.linalg.norm(stiffness * (found["strain"] - full["strain"])[0]),
    )
    assert 0 < begun <= bound[0]


def test_a_reference_goes_on_from_a_reference(tmp_path):
    """But for what is lost between the particles, which falls with the square of Δx."""
    errors = []
    for count in (20, 40):
        settings = scenes.settings(particle_count=count, damping="0.3*(1 + sin(2*pi*x/L))")
        settings |= {"initial_velocity": "1e-2*sin(2*pi*x/L)", "time_step": 2e-3}
        settings |= {"youngs_modulus": "0.1*(1 + 0.5*cos(2*pi*x/L))"}
        full = solve_reference(make_scene("whole", **settings), "centred")
        full.to_netcdf(tmp_path / f"{count}.nc")
        del settings["initial_velocity"]
        start = {"from": str(tmp_path / f"{count}.nc"), "t": 0.5}
        scene = make_scene("rest", start=start, **settings | {"duration": 0.5})
        found = reference.solve_centred(scene, estimate_error=False)
        expected = full.velocity.values[-scene.error_times.size :]
        errors.append(np.linalg.norm(found["velocity"] - expected) / np.linalg.norm(expected))
    assert errors[1] < errors[0] / 4 < 1e-4


def test_twins_start_from_the_state_too(tmp_path):
    whole("periodic", tmp_path)
    scene = rest("periodic", tmp_path / "sph.nc")
    taken = snapshots.extract(scene, SAMPLING, _sph(scene)) | rounding.twins(scene, SAMPLING)
    np.testing.assert_allclose(taken["density_twins"], taken["density_snapshots"], rtol=1e-13)


def test_no_energy_is_predicted_of_a_strained_start(tmp_path):
    whole("jittered", tmp_path)
    scene = rest("jittered", tmp_path / "sph.nc")
    assert scene.is_conservative
    assert "predicted_energy_growth" not in waves.predict(scene)


def test_a_scene_with_a_start_goes_to_another_process_and_back(tmp_path):
    whole("bar", tmp_path)
    scene = rest("bar", tmp_path / "sph.nc")
    again = pickle.loads(pickle.dumps(scene))
    assert np.array_equal(again.velocity0(), scene.velocity0())
    assert np.array_equal(again.starting_density(), scene.starting_density())


def changed(path, name, change):
    with netCDF4.Dataset(path, "a") as file:
        values = file[name][...]
        change(values)
        file[name][...] = values


def test_the_checksum_is_of_the_state(tmp_path):
    path = tmp_path / "sph.nc"
    whole("periodic", tmp_path)
    first = rest("periodic", path).start.checksum
    changed(path, "velocity", lambda v: v.__setitem__((3, 3), 7))
    assert rest("periodic", path).start.checksum == first
    changed(path, "density", lambda rho: rho.__setitem__((50, 3), 1.01))
    assert rest("periodic", path).start.checksum != first


REFUSALS = [
    ({"start": {"from": "none.nc", "t": 0}}, ["start.from = none.nc", "no such file"]),
    ({"start": {"from": __file__, "t": 0}}, ["start.from = ", "no NetCDF file"]),
    ({"start": {"from": "a" * 5000, "t": 0}}, ["start.from = aaa", "no such file"]),
    ({"start": {"from": "http://localhost:1/x.nc", "t": 0}}, ["start.from = http", "no such file"]),
    ({"t": 0.505}, ["start.t = 0.505", "does not hold it", "0 to 1, the nearest 0.5"]),
    ({"t": 1.5}, ["start.t = 1.5", "does not hold it"]),
    ({"particle_count": 41}, ["velocity is of shape (101, 40)", "101 times of 41 particles"]),
    ({"domain_length": 2}, ["other particles: particle 1 is at x = 0.025, and at 0.05 here"]),
    ({"positions": {"jitter": 0.2}}, ["other particles: particle 1"]),
    ({"boundary": ["fixed", "free"], "particle_count": 40}, ["other particles"]),
    ({"initial_velocity": 0}, ["start = {from", "one of both is allowed"]),
    ({"density": lambda rho: rho.__setitem__((50, 3), -1)}, ["start.t = 0.5", "above 0"]),
    ({"velocity": lambda v: v.__setitem__((50, 3), np.nan)}, ["start.t = 0.5", "must be finite"]),
    ({"t_": lambda t: t.__setitem__(50, np.nan)}, ["start.from = ", "t must be finite"]),
]


@pytest.mark.parametrize(("change", "parts"), REFUSALS)
def test_what_cannot_be_started_from_is_refused(change, parts, tmp_path):
    path = tmp_path / "sph.nc"
    whole("periodic", tmp_path)
    settings = scenes.settings(**scenes.VARIED)
    del settings["initial_velocity"]
    start = {"from": str(path), "t": change.get("t", 0.5)}
    for name, given in change.items():
        if callable(given):
            changed(path, name.rstrip("_"), given)
        elif name != "t":
            settings[name] = given
    with pytest.raises(ConfigError, match=r"^scene rest: ") as caught:
        make_scene("rest", **{"start": start, **settings})
    assert all(part in str(caught.value) for part in parts), caught.value
    assert str(caught.value).count("\n") == 0


def test_files_that_hold_too_little_or_no_numbers_are_refused(tmp_path):
    path = tmp_path / "odd.nc"
    settings = scenes.settings(start={"from": str(path), "t": 0})
    del settings["initial_velocity"]
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("t", 1)
        file.createDimension("x", 40)
        for name in ("t", "x", "velocity"):
            file.createVariable(name, "f8", ("t",) if name == "t" else ("x",))
    with pytest.raises(ValueError, match="it holds t, x, velocity, but not strain"):
        Scene.from_settings("rest", settings)
    with netCDF4.Dataset(path, "a") as file:
        file.createVariable("strain", "f8", ("t", "x"))
    with pytest.raises(ValueError, match=r"velocity is of shape \(40,\)"):
        Scene.from_settings("rest", settings)
    path.write_bytes(path.read_bytes()[:-3000])
    with pytest.raises(ValueError, match=r"scene rest: start\.from = "):
        Scene.from_settings("rest", settings)


def test_the_end_of_a_bar_stands_still_in_what_it_starts_from(tmp_path):
    whole("bar", tmp_path)
    changed(tmp_path / "sph.nc", "velocity", lambda v: v.__setitem__((50, 0), 1e-3))
    with pytest.raises(ValueError, match=r"velocity at an end that is fixed is 0\.001, and must"):
        rest("bar", tmp_path / "sph.nc")
