"""The public functions: lazy, typed, strict, and the same numbers as the workflow's."""

import ast
import dataclasses
import fnmatch
import inspect
import logging
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
import scenes
import xarray as xr
from packaging.requirements import Requirement

import sphpod
from sphpod.full import lifted, sph
from sphpod.numerics import error
from sphpod.pipeline.dataset import VARIABLES
from sphpod.reduced import certificate, lifted_rom, pod, rom, rounding, snapshots

ROOT = Path(__file__).parents[1]
SETTINGS = scenes.settings()
VARIED = {key: value for key, value in SETTINGS.items() if key not in scenes.VARIED} | scenes.VARIED
SAMPLING = {"range": [0, 0.8], "count": 12}


@pytest.fixture(scope="module")
def scene():
    return sphpod.make_scene("test", **VARIED)


@pytest.fixture(scope="module")
def solved(scene):
    """Full SPH, the lifted full model, a reference, and modes of either kind."""
    taken = sphpod.take_snapshots(scene, **SAMPLING)
    return {
        "full": sphpod.solve_sph(scene),
        "lifted": sphpod.solve_lifted(scene),
        "reference": sphpod.solve_reference(scene, "centred"),
        "snapshots": taken,
        "modes": sphpod.decompose(taken),
        "energy_modes": sphpod.decompose_lifted(scene, taken),
    }


# --- Names ----------------------------------------------------------------------------------------


def test_importing_the_package_imports_nothing_else():
    program = (
        "import sys; before = set(sys.modules); import sphpod; print(*set(sys.modules) - before)"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert run.stdout.split() == ["sphpod"]


def test_the_package_imports_nothing_that_would_count_as_code_of_every_job():
    tree = ast.parse((ROOT / "sphpod" / "__init__.py").read_text(encoding="utf-8"))
    imports = [n for n in ast.walk(tree) if isinstance(n, ast.Import | ast.ImportFrom)]
    assert [node.module for node in imports if isinstance(node, ast.ImportFrom)] == ["importlib"]
    assert len(imports) == 1


def test_public_names_are_there_typed_and_no_names_of_modules():
    stub = ast.parse((ROOT / "sphpod" / "__init__.pyi").read_text(encoding="utf-8"))
    typed = {
        (alias.name, node.module)
        for node in stub.body
        if isinstance(node, ast.ImportFrom) and node.module
        for alias in node.names
    }
    public = set(sphpod.__all__) - {"__version__"}
    assert {name for name, _ in typed} == public
    modules = {path.stem for path in (ROOT / "sphpod").glob("*")}
    assert not public & modules
    for name, module in typed:
        assert getattr(sphpod, name) is getattr(sys.modules[module], name)
        assert name in dir(sphpod)
    assert (ROOT / "sphpod" / "py.typed").is_file()
    with pytest.raises(AttributeError, match="no attribute 'solve'"):
        _ = sphpod.solve  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", sorted(set(sphpod.__all__) - {"__version__"}))
def test_public_names_say_what_they_take_give_and_raise(name):
    public = getattr(sphpod, name)
    text = inspect.getdoc(public)
    assert text
    if not inspect.isfunction(public):
        return
    assert "Raises" in text or "errors raised" in text
    for parameter in inspect.signature(public).parameters.values():
        assert parameter.annotation is not inspect.Parameter.empty
        assert re.search(rf"\b{parameter.name}\b", text)
    assert inspect.signature(public).return_annotation is not inspect.Signature.empty


# --- Scenes ---------------------------------------------------------------------------------------


def texts(scene):
    """Fields of a scene, expressions as their text."""
    fields = (field.name for field in dataclasses.fields(scene))
    return {
        name: getattr(getattr(scene, name), "text", repr(getattr(scene, name))) for name in fields
    }


def test_a_scene_of_keywords_is_that_of_a_file(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "scenes:\n  a: {domain_length: 2, duration: 1, initial_velocity: 1e-3*sin(pi*x),\n"
        "    initial_density: 1, youngs_modulus: 0.1, particle_count: 40, smoothing_ratio: 1.04,\n"
        "    time_step: 2e-3, error_interval: 0.01, positions: {jitter: 0.2, seed: 3},\n"
        "    force: {time: cos(t), profile: 1e-3*x}, samplings: {few: {range: [0, 1], count: 4}}}\n"
    )
    made = sphpod.make_scene(
        "a",
        domain_length=np.float64(2),
        duration=1.0,
        initial_velocity="1e-3*sin(pi*x)",
        initial_density=np.int64(1),
        youngs_modulus=0.1,
        particle_count=np.int32(40),
        smoothing_ratio=1.04,
        time_step=2e-3,
        error_interval=0.01,
        positions={"jitter": 0.2, "seed": 3},
        force={"time": "cos(t)", "profile": "1e-3*x"},
    )
    settings = texts(made)
    assert settings["initial_density"] == "1"
    assert settings == texts(sphpod.load_scene(path)) == texts(sphpod.load_scene(str(path), "a"))
    assert sphpod.load_samplings(path) == {"few": {"range": [0, 1], "count": 4}}


@pytest.mark.parametrize(
    ("changes", "answer"),
    [
        ({"dampening": 1}, r"dampening = 1: unknown key, did you mean damping\? allowed are .*"),
        ({"particle_count": 40.5}, "particle_count = 40.5: it must be a whole number .*"),
        ({"particle_count": np.int64(3)}, "particle_count = 3: it must be at least 5 .*"),
        ({"duration": float("inf")}, r"duration = \.inf: it must be a number .*"),
        ({"duration": float("nan")}, r"duration = \.nan: it must be a number .*"),
        ({"initial_velocity": float("nan")}, r"initial_velocity = \.nan: it must be a number .*"),
        ({"initial_density": lambda x: x}, "initial_density = <function .*: it must be .*"),
        ({"damping": np.ones(2)}, r"damping = \[1, 1\]: it must be .*"),
        ({"damping": [len]}, r"damping = \[<built-in .*: it must be .*"),
        ({"damping": 1j}, "damping = 1j: it must be .*"),
        ({"time_step": 0.5, "error_interval": 0.5, "duration": 90}, "time_step = 0.5: .* grow .*"),
        ({"samplings": {}}, "samplings = {}: unknown key; allowed are domain_length, .*"),
    ],
)
def test_keywords_are_refused_in_one_sentence(changes, answer):
    with pytest.raises(sphpod.ConfigError) as caught:
        sphpod.make_scene("w", **(SETTINGS | changes))
    assert re.fullmatch(f"scene w: {answer}", str(caught.value)), str(caught.value)


def test_a_name_that_is_none_is_refused():
    with pytest.raises(sphpod.ConfigError, match="name = New Wave: allowed are lower-case"):
        sphpod.make_scene("New Wave", **SETTINGS)


@pytest.mark.parametrize(
    ("name", "answer"),
    [
        ("wavs", "scene wavs: no such scene; allowed are waves, damped_forced, "),
        (None, "name = None: one of several must be named; allowed are waves, "),
    ],
)
def test_a_scene_that_a_file_lacks_is_refused(name, answer):
    with pytest.raises(sphpod.ConfigError, match=answer):
        sphpod.load_scene(ROOT / "config" / "small.yaml", name)


@pytest.mark.parametrize(
    ("sampling", "answer"),
    [
        ({}, "snapshots = {}: it must be given by range and count, .*"),
        ({"range": [0, 2], "count": 3}, r"snapshots.range = \[0, 2\]: it must rise and end .*"),
        ({"range": (0, 1), "count": 0}, "snapshots.count = 0: it must be at least 1 .*"),
        ({"range": [0, 1], "cuont": 3}, "snapshots.cuont = 3: unknown key, did you mean count.*"),
        (
            {"velocity_times": np.array([0, 0.5]), "density_times": [0.5, 0.5001]},
            "snapshots.density_times = .*: two snapshots fall on the time step at 0.5; .*",
        ),
    ],
)
def test_samplings_are_refused_in_one_sentence(scene, sampling, answer):
    with pytest.raises(sphpod.ConfigError) as caught:
        sphpod.take_snapshots(scene, **sampling)
    assert re.fullmatch(f"scene test: samplings.{answer}", str(caught.value)), str(caught.value)


# --- Numbers --------------------------------------------------------------------------------------


def same(found, arrays):
    assert set(arrays) <= set(found.variables)
    for name, values in arrays.items():
        np.testing.assert_array_equal(found[name].values, values, err_msg=name)


def test_solutions_are_those_of_the_workflow(scene, solved):
    sampling = {"name": "s", **SAMPLING}
    steps = snapshots.output_steps(scene, [sampling])
    full = sph.solve(scene, steps)
    samples = np.isin(steps, scene.error_steps)
    same(solved["full"], {field: full[field][samples] for field in error.FIELDS})
    taken = snapshots.extract(scene, sampling, full) | rounding.twins(scene, sampling)
    same(solved["snapshots"], taken)
    same(solved["modes"], pod.decompose(taken))
    same(solved["energy_modes"], lifted_rom.decompose(scene, taken))
    same(solved["lifted"], lifted.solve(scene, "exact"))


@pytest.mark.parametrize("method", ["original", "linearized", "frozen3", "lifted_euler"])
def test_errors_of_a_sweep_are_those_of_the_fields(scene, solved, method):
    modes = solved["energy_modes" if method == "lifted_euler" else "modes"]
    full, reference = solved["full"], solved["reference"]
    swept = sphpod.sweep(scene, method, [2, 5], modes, full, reference)
    for count in (2, 5):
        model = sphpod.solve_reduced(scene, method, modes, count)
        for field in error.FIELDS:
            for against, solution in (("sph", full), ("reference", reference)):
                # Errors by projection add squares in another order.
                assert sphpod.relative_error(model[field], solution[field]) == pytest.approx(
                    swept[f"{field}_error_{against}"].sel(mode_count=count).item(), rel=1e-6
                )


def test_coordinates_are_those_of_the_workflow(scene, solved):
    modes, full = ({k: v.values for k, v in solved[name].items()} for name in ("modes", "full"))
    swept = rom.sweep(scene, "original", [4], modes, full, full)
    model = sphpod.solve_reduced(scene, "original", solved["modes"], 4)
    same(model, {name: swept[name] for name in ("velocity_coordinates", "density_coordinates")})


def test_a_bound_holds_of_the_fields_it_comes_with(scene, solved):
    model = sphpod.solve_reduced(scene, "lifted_exact", solved["energy_modes"], 5)
    mass, stiffness = lifted.energy_weights(scene)
    full = solved["lifted"]
    wrong = np.hypot(
        np.linalg.norm(mass * (model.velocity - full.velocity).values, axis=1),
        np.linalg.norm(stiffness * (model.strain - full.strain).values, axis=1),
    )
    assert wrong.max() > 1e-8
    assert (wrong <= model.error_bound.values * (1 + 1e-9)).all()
    certified = certificate.certify(
        scene,
        [5],
        {name: values.values for name, values in solved["energy_modes"].items()},
        {name: full[name].values for name in ("velocity", "strain")},
        {name: full[name].values for name in ("velocity", "density")},
    )
    same(model, {"error_bound": certified["error_bound"]})


def test_results_have_units_and_meanings_and_survive_a_file(scene, solved, tmp_path):
    results = [*solved.values(), sphpod.compare(scene, solved["full"], {"fd": solved["reference"]})]
    for number, result in enumerate(results):
        path = tmp_path / f"{number}.nc"
        result.to_netcdf(path)
        with xr.open_dataset(path, decode_timedelta=False) as again:
            for name, values in again.variables.items():
                meaning = VARIABLES[str(name)]
                assert values.dims == meaning.dims
                assert values.attrs["long_name"] == meaning.long_name
                assert values.attrs.get("units", "") == meaning.units
                np.testing.assert_array_equal(values, result[name])


def test_arrays_do_as_well_as_datasets(scene, solved):
    arrays = {name: {k: v.values for k, v in solved[name].items()} for name in solved}
    swept = [
        sphpod.sweep(scene, "original", [1, 2], given["modes"], given["full"], given["reference"])
        for given in (solved, arrays)
    ]
    xr.testing.assert_identical(*swept)


def test_what_is_predicted_is_reported(caplog):
    scene = sphpod.make_scene("wild", **(SETTINGS | {"time_step": 1e-2, "duration": 5}))
    with caplog.at_level(logging.WARNING):
        full = sphpod.solve_sph(scene)
    assert "wild: time_step = 0.01: explicit Euler lets the energy" in caplog.text
    energy = (full.velocity**2).mean("x") + 0.1 * ((1 / full.density - 1) ** 2).mean("x")
    growth = float(energy[-1] / energy[0])
    assert growth == pytest.approx(full.attrs["predicted_energy_growth"], rel=1e-2)


# --- Refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, -1, 2.5, True])
def test_no_modes_are_refused(scene, solved, count):
    with pytest.raises(ValueError, match=f"scene test: mode_count = {count}: it must be a whole"):
        sphpod.solve_reduced(scene, "original", solved["modes"], count)


def test_unknown_words_are_refused(scene, solved):
    with pytest.raises(ValueError, match=r"method = lifted: allowed are original.*, lifted_exact"):
        sphpod.solve_reduced(scene, "lifted", solved["modes"], 2)
    with pytest.raises(ValueError, match="reference = analytic: allowed are fd, centred, chain"):
        sphpod.solve_reference(scene, "analytic")
    with pytest.raises(ValueError, match="scene test: no exact solution is known"):
        sphpod.solve_reference(scene, "exact")


def test_data_of_another_kind_are_refused(scene, solved):
    with pytest.raises(ValueError, match=r"modes of lifted_exact holds .*, but not scaled_velo"):
        sphpod.solve_reduced(scene, "lifted_exact", solved["modes"], 2)
    with pytest.raises(ValueError, match=r"modes of original holds .*, but not velocity_modes"):
        sphpod.solve_reduced(scene, "original", solved["energy_modes"], 2)
    with pytest.raises(ValueError, match=r"full holds .*, but not strain"):
        sphpod.sweep(
            scene, "lifted_exact", [1], solved["energy_modes"], solved["full"], solved["reference"]
        )


def test_data_of_other_particles_or_times_are_refused(scene, solved):
    other = sphpod.make_scene("other", **(VARIED | {"particle_count": 30}))
    with pytest.raises(ValueError, match="other: modes of original: its 40 values of x are not"):
        sphpod.solve_reduced(other, "original", solved["modes"], 2)
    late = solved["full"].isel(t=slice(1, None))
    with pytest.raises(ValueError, match="test: sph: its 100 values of t are not the 101 of"):
        sphpod.compare(scene, late, {"fd": solved["reference"]})
    with pytest.raises(ValueError, match=r"shape \(100, 40\): it must have .* \(101, 40\)"):
        sphpod.relative_error(late.velocity, solved["full"].velocity)


def test_breaking_down_is_reported(scene):
    folding = sphpod.make_scene("fold", **(SETTINGS | {"initial_velocity": "sin(2*pi*x/L)"}))
    with pytest.raises(sphpod.Breakdown, match="fold") as caught:
        sphpod.solve_sph(folding)
    assert 0 < caught.value.time < 1


# --- Package --------------------------------------------------------------------------------------


def test_an_installed_package_has_the_files_that_it_reads():
    """What is declared as data of the package is all that lies beside its modules."""
    with open(ROOT / "pyproject.toml", "rb") as file:
        declared = tomllib.load(file)["tool"]["setuptools"]["package-data"]["*"]
    for path in (ROOT / "sphpod").rglob("*.*"):
        if "__pycache__" not in path.parts and path.suffix != ".py":
            assert any(fnmatch.fnmatch(path.name, pattern) for pattern in declared), path.name


@pytest.mark.slow
def test_numerics_need_no_package_of_the_workflow():
    program = (
        "import sys, sphpod; [getattr(sphpod, name) for name in sphpod.__all__];"
        "import sphpod.figures.plotting; print(*{name.partition('.')[0] for name in sys.modules})"
    )
    run = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert not {"snakemake", "pandas", "pytest", "hypothesis"} & set(run.stdout.split())


def test_what_is_declared_is_pinned():
    with open(ROOT / "pyproject.toml", "rb") as file:
        project = tomllib.load(file)
    extras = project["project"]["optional-dependencies"]
    groups_of = project["dependency-groups"]
    default = [group for name, group in extras.items() if name != "cluster"]
    for path, groups in (
        ("environment.txt", [project["project"]["dependencies"], *default]),
        ("environment-lint.txt", [groups_of["lint"]]),
        ("environment-docs.txt", [project["project"]["dependencies"], groups_of["docs"]]),
        ("environment-deposit.txt", [groups_of["deposit"]]),
        ("environment-cf.txt", [groups_of["cf"]]),
        ("environment-cluster.txt", [extras["cluster"]]),
    ):
        text = (ROOT / path).read_text(encoding="utf-8")
        assert "://" not in text
        pinned = dict(re.findall(r"^([\w-]+)==(\S+)", text, re.M))
        for group in groups:
            for wanted in map(Requirement, group):
                if wanted.name == "sphpod":
                    assert wanted.extras <= set(extras)
                else:
                    name = re.sub(r"[._-]+", "-", wanted.name).lower()
                    assert wanted.specifier.contains(pinned[name]), wanted
