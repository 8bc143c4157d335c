"""What the documents say of names, units, files, commands and refusals is true."""

import dataclasses
import pydoc
import re
import runpy
import shlex
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from snakemake.cli import get_argument_parser  # type: ignore[import-untyped]

import sphpod
from sphpod.config import config, configuration, refusals
from sphpod.paper import claims
from sphpod.pipeline.dataset import VARIABLES
from sphpod.scene import kernel
from sphpod.scene.scene import Scene
from sphpod.studies.study import studies

ROOT = Path(__file__).parents[1]
DOCUMENTS = {
    path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
    for path in (
        ROOT / "README.md",
        ROOT / "CHANGELOG.md",
        ROOT / "CONTRIBUTING.md",
        ROOT / "config" / "README.md",
        ROOT / "figures" / "README.md",
        *sorted((ROOT / "docs").glob("*.md")),
    )
}
README = DOCUMENTS["README.md"]
EXAMPLE = "config/mine.yaml"
"""The file that docs/adding-a-scene.md lets the reader write."""

UNITS = {"m s-1": "m/s", "kg m-3": "kg/m³", "kg0.5 s-1": "√(J/m²)", "s-1": "1/s", "J m-2": "J/m²"}
"""Units of datasets as the documents write them, where they differ."""


def rows(text: str, header: str) -> list[list[str]]:
    """Cells of the rows of the table whose header begins with a cell."""
    lines = text[text.index(f"| {header} |") :].split("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]


def groups(text: str, header: str) -> dict[str, list[list[str]]]:
    """Rows of a table by the bold cell that they stand under."""
    found: dict[str, list[list[str]]] = {}
    for row in rows(text, header):
        if row[0].startswith("**"):
            found[row[0].strip("*")] = []
        else:
            found[list(found)[-1]].append(row)
    return found


def quoted(text: str) -> list[str]:
    return re.findall(r"`([^`]+)`", text)


def blocks(text: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", text, re.S)


def numbers(cell: str) -> list[str]:
    """Numbered names of a cell such as ``E01, T04–T06`` or ``3.6–3.11``, with those between."""
    found = []
    for part in filter(None, cell.split(", ")):
        first, last = (*part.split("–"), part)[:2]
        match = re.fullmatch(r"(.*?\.?)(\d+)", first)
        assert match is not None, part
        stem, start = match.groups()
        found += [
            f"{stem}{number:0{len(start)}d}"
            for number in range(int(start), int(last.removeprefix(stem)) + 1)
        ]
    return found


@pytest.fixture(scope="module")
def paper() -> dict[str, Any]:
    return config.load([ROOT / "config" / "config.yaml"])


@pytest.fixture(scope="module")
def schema() -> dict[str, Any]:
    """Sections of the configuration of a scene, by name."""
    scene = refusals.node_at(refusals.written_out(configuration.schema()), ("scenes", "wave"))
    places = {
        "scene": (),
        "sampling": ("samplings", "few"),
        "acceleration": ("acceleration", "few"),
        "figure": ("figures", 0),
    }
    return {name: refusals.node_at(scene, path) for name, path in places.items()}


@pytest.fixture
def example(tmp_path) -> Path:
    block, *_ = blocks(DOCUMENTS["docs/adding-a-scene.md"], "yaml")
    path = tmp_path / EXAMPLE
    path.parent.mkdir()
    path.write_text(block, encoding="utf-8")
    return path


# --- Notation -------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def notation() -> dict[str, dict[str, tuple[str, str]]]:
    """Dimensions and unit of each name, by group."""
    table: dict[str, dict[str, tuple[str, str]]] = {}
    for group, entries in groups(DOCUMENTS["docs/notation.md"], "Symbol").items():
        table[group] = {}
        for _, meaning, names, dims, units, _ in entries:
            assert meaning
            each_name = quoted(names)
            each_dims = re.findall(r"\([^)]*\)", dims) or [dims]
            each_unit = units.split(", ")
            for n, name in enumerate(each_name):
                table[group][name] = (
                    each_dims[n if len(each_dims) == len(each_name) else 0],
                    each_unit[n if len(each_unit) == len(each_name) else 0],
                )
    return table


def test_notation_has_every_variable_with_its_dimensions_and_unit(notation):
    stored = ["Solutions", "Errors", "Snapshots", "Modes", "Reduced models", "Lifted models"]
    stored += ["CPU times", "Benchmarks"]
    written = {name: entry for group in stored for name, entry in notation[group].items()}
    assert written == {
        name: (f"({', '.join(meaning.dims)})", UNITS.get(meaning.units, meaning.units))
        for name, meaning in VARIABLES.items()
    }


def test_notation_has_every_key_of_a_scene_and_a_sampling_with_its_unit(notation, schema):
    keys = set(refusals.keys_of(schema["scene"]))
    fields = {field.name for field in dataclasses.fields(Scene)}
    assert set(notation["Scene"]) == keys | fields
    assert set(notation["Sampling"]) == {
        *refusals.keys_of(schema["sampling"]),
        *refusals.keys_of(schema["acceleration"]),
    }
    for group, table in (("Scene", "scene"), ("Sampling", "sampling")):
        for key, field in refusals.keys_of(schema[table]).items():
            if unit := schema_unit(field):
                assert (key, notation[group][key][1]) == (key, unit)


def test_notation_has_all_that_a_scene_and_the_kernel_give(notation):
    fields = {field.name for field in dataclasses.fields(Scene)}
    given = {name for name in vars(Scene) if not name.startswith("_")}
    assert set(notation["Discretisation"]) == given - fields - {"from_settings"}
    source = Path(kernel.__file__).read_text(encoding="utf-8")
    assert all(re.search(rf"\b{name}\b", source) for name in notation["Kernel"])


def schema_unit(field: Mapping[str, Any]) -> str | None:
    """Unit that a field's description has in brackets."""
    match = re.search(r"\[([^\]]+)\]", field.get("description", ""))
    return match[1].replace("m2", "m²").replace("m3", "m³").replace("s2", "s²") if match else None


# --- Adding a scene -------------------------------------------------------------------------------


def test_what_the_configuration_folder_shows_is_accepted(tmp_path):
    (block,) = blocks(DOCUMENTS["config/README.md"], "yaml")
    path = tmp_path / "mine.yaml"
    path.write_text(block, encoding="utf-8")
    assert config.load([path])["output"] == "mine"


def test_example_scene_is_accepted(example):
    settings = config.load([example])
    assert settings["output"] == "mine"
    (scene,) = settings["scenes"].values()
    assert scene["references"] == ["centred"]
    assert {figure["kind"] for figure in scene["figures"]} >= {"profile", "error", "acceleration"}


def test_coefficients_in_time_are_accepted_as_written(example):
    settings = config.read_yaml(example)
    _, block = blocks(DOCUMENTS["docs/adding-a-scene.md"], "yaml")
    settings["scenes"]["shaker"] |= yaml.safe_load(textwrap.dedent(block))
    example.write_text(yaml.safe_dump(settings))
    assert "t < 4" in config.load([example])["scenes"]["shaker"]["damping"]


def test_surveys_are_accepted_as_written(tmp_path):
    worked = config.read_yaml(ROOT / "config" / "surveys.yaml")
    written = blocks(DOCUMENTS["docs/parameter-studies.md"], "yaml")
    scene, uncertain, survey, design = (yaml.safe_load(textwrap.dedent(one)) for one in written)
    scenes, surveys = worked["scenes"], survey["surveys"]
    scenes["graded_bar"] |= scene["scenes"]["graded_bar"]
    surveys["soft_inclusion"] = worked["surveys"]["soft_inclusion"] | design
    path = tmp_path / "surveys.yaml"
    for parameters in [scene["scenes"]["graded_bar"]["parameters"], uncertain]:
        scenes["graded_bar"]["parameters"] |= parameters
        path.write_text(yaml.safe_dump({"scenes": scenes, "surveys": surveys}))
        assert set(config.load([path])["surveys"]) == {"graded_bar", "soft_inclusion"}


def test_every_key_is_explained_with_its_unit(schema):
    table = groups(DOCUMENTS["docs/adding-a-scene.md"], "Key")
    assert list(table) == ["Scene", "Sampling", "Acceleration", "Figure"]
    for group, entries in table.items():
        definition = schema[group.lower()]
        needed = [branch.get("required", ()) for branch in refusals.branches(definition)]
        keys = {key: row for row in entries for key in quoted(row[0])}
        assert {key.split(".")[0] for key in keys} == set(refusals.keys_of(definition))
        for key, field in refusals.keys_of(definition).items():
            _, meaning, unit, default = keys[key]
            assert meaning
            assert (key, default.startswith("required")) == (
                key,
                all(key in keys for keys in needed) or (group == "Figure" and key in CONDITIONAL),
            )
            if expected := schema_unit(field):
                assert (key, unit.split(", ")[0]) == (key, expected)


def test_every_kind_of_figure_is_in_the_table_of_keys():
    (row,) = [row for row in rows(DOCUMENTS["docs/adding-a-scene.md"], "Key") if row[0] == "`kind`"]
    assert set(quoted(row[1])) == set(config.FIGURES)


def test_every_key_and_quantity_of_a_survey_is_explained():
    document = DOCUMENTS["docs/parameter-studies.md"]
    survey = refusals.node_at(refusals.written_out(configuration.schema()), ("surveys", "one"))
    explained = [key for row in rows(document, "Key") for key in quoted(row[0])]
    assert sorted(explained) == sorted(refusals.keys_of(survey))
    quantity = refusals.node_at(survey, ("quantities", "one"))
    kinds = [refusals.keys_of(kind)["kind"]["const"] for kind in refusals.branches(quantity)]
    listed = [kind for row in rows(document, "Quantity") for kind in quoted(row[0])]
    assert sorted(listed) == sorted(kinds)


CONDITIONAL = ("sampling", "position")
"""Keys of a figure that only some kinds have, and need."""


def test_refusals_are_worded_as_written(example):
    settings = config.read_yaml(example)
    (scene,) = settings["scenes"]
    for change, answer in rows(DOCUMENTS["docs/adding-a-scene.md"], "Change"):
        (text,) = quoted(change)
        key, _, value = text.partition(": ")
        changed = yaml.safe_load(yaml.safe_dump(settings))
        *parents, last = key.split(".")
        place = changed["scenes"][scene]
        for parent in parents:
            place = place[parent]
        example.write_text(f"value: {value}")
        place[last] = config.read_yaml(example)["value"]
        example.write_text(yaml.safe_dump(changed, sort_keys=False))
        with pytest.raises(config.ConfigError) as caught:
            config.load([example])
        pattern = re.escape(answer).replace("…", ".*")
        assert re.fullmatch(pattern, str(caught.value)), str(caught.value)


# --- Commands, links and paths --------------------------------------------------------------------


def snakemake_commands() -> list[list[str]]:
    """Words of all Snakemake commands of the documents, each once."""
    lines = [
        line
        for text in DOCUMENTS.values()
        for block in blocks(text, "sh")
        for line in block.split("\n")
    ]
    # What is in brackets stands for words of one's own.
    bare = (re.sub(r"\[.*?\]", "", line) for line in lines)
    split = [tuple(shlex.split(line, comments=True)) for line in bare]
    programs = ("snakemake",), (".venv/bin/snakemake",)
    return [list(words[1:]) for words in dict.fromkeys(split) if words[:1] in programs]


def test_commands_are_understood():
    parser = get_argument_parser()
    commands = snakemake_commands()
    assert commands
    for words in commands:
        options = parser.parse_args(words)
        for path in options.configfile or ():
            assert str(path) == EXAMPLE or (ROOT / path).is_file(), words


@pytest.mark.workflow
def test_targets_are_known_to_the_workflow(example):
    """A dry run for each configuration that the documents build single targets of."""
    parser = get_argument_parser()
    targets: dict[tuple[str, ...], set[str]] = {}
    for words in snakemake_commands():
        options = parser.parse_args(words)
        given = ["--configfile", *map(str, options.configfile)] if options.configfile else []
        given += ["--config", *options.config] if options.config else []
        targets.setdefault(tuple(given), set()).update(options.targets)
    assert sum(map(len, targets.values())) > 3
    for path in (ROOT / "config").glob("*.yaml"):
        if not (example.parent / path.name).exists():
            shutil.copy(path, example.parent)
    for chosen, names in targets.items():
        if not names:
            continue
        program = [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")]
        run = subprocess.run(
            [*program, "--dry-run", *sorted(names), *chosen],
            cwd=example.parents[1],
            capture_output=True,
            text=True,
        )
        assert run.returncode == 0, run.stdout


@pytest.mark.workflow
@pytest.mark.parametrize("document", ["README.md", "docs/adding-a-scene.md"])
def test_results_are_read_as_written(document, example, monkeypatch, capsys):
    """Blocks that open results, of files that are built for them; the claim E01 is printed."""
    programs = [b for b in blocks(DOCUMENTS[document], "python") if "xarray as" in b]
    files = re.findall(r'open_dataset\("(.+?)"\)', "".join(programs))
    given = ["--configfile", EXAMPLE]
    if document == "README.md":
        files.append("results/damped/uniform12/original/k1-12.nc")
        given = ["--configfile", str(ROOT / "config" / "config.yaml")]
    folder = example.parents[1]
    run = subprocess.run(
        [sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile"), "--cores", "2",
         *files, *given],
        cwd=folder, capture_output=True, text=True,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    monkeypatch.chdir(folder)
    for program in programs:
        exec(program, {})
    printed = re.findall(r"^0\.\d+$", capsys.readouterr().out, re.M)
    assert document != "README.md" or f"{float(printed[0]):.3e}" == "4.520e-02"


@pytest.mark.slow
@pytest.mark.parametrize("document", ["README.md", "docs/quickstart.md"])
def test_quick_start_prints_what_it_says(document, tmp_path, monkeypatch, capsys):
    """Its blocks are one program, which runs without the workflow; comments are what it prints."""
    program = "".join(b for b in blocks(DOCUMENTS[document], "python") if "xarray as" not in b)
    (tmp_path / "program.py").write_text(program)
    (tmp_path / "config").symlink_to(ROOT / "config")
    monkeypatch.chdir(tmp_path)
    runpy.run_path("program.py")
    said = re.findall(r"^(?:print.*  )?# (.*)$", program, re.M)
    assert said
    assert capsys.readouterr().out.splitlines() == said
    for drawn in re.findall(r'savefig\("(.*?)"\)', program):
        assert Path(drawn).stat().st_size > 5000, drawn


def test_every_public_name_is_on_its_page():
    shown = re.findall(r"^::: ([\w.]+)$", DOCUMENTS["docs/api.md"], re.M)
    for name in set(sphpod.__all__) - {"__version__"}:
        home = getattr(sphpod, name).__module__
        assert {home, f"{home}.{name}"} & set(shown), name


def test_make_targets_exist():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for text in DOCUMENTS.values():
        for block in blocks(text, "sh"):
            for target in re.findall(r"^make (\w+)", block, re.M):
                assert re.search(rf"^{target}:", makefile, re.M), target


@pytest.mark.parametrize("document", DOCUMENTS)
def test_links_lead_somewhere(document):
    for link in re.findall(r"\]\(([^)\s]+)\)", DOCUMENTS[document]):
        if link.startswith("https://"):
            continue
        path, _, anchor = link.partition("#")
        target = (ROOT / document).parent / path if path else ROOT / document
        assert target.exists(), link
        if anchor:
            headings = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.M)
            slugs = [re.sub(r"[^\w -]", "", title).lower().replace(" ", "-") for title in headings]
            assert anchor in slugs, link


@pytest.mark.parametrize("document", DOCUMENTS)
def test_files_and_names_that_are_mentioned_exist(document):
    folders = "sphpod|workflow|config|tests|docs|profiles"
    for text in quoted(re.sub(r"```.*?```", "", DOCUMENTS[document], flags=re.S)):
        if re.fullmatch(rf"(?:{folders})/[\w./-]*", text) and text != EXAMPLE:
            assert (ROOT / text).exists(), text
        if re.fullmatch(r"sphpod(\.\w+)+", text):
            assert pydoc.locate(text) is not None, text


# --- README ---------------------------------------------------------------------------------------


def test_map_covers_the_paper(paper):
    table = rows(README, "Section")
    drawn = [f["name"] for s in paper["scenes"].values() for f in s["figures"]]
    drawn += [figure["name"] for figure in paper["illustrations"]]
    listed = [figure for row in table for figure in numbers(row[2])]
    assert sorted(listed) == sorted(name.partition("_")[0] for name in drawn)
    stated = [claim for row in table for claim in numbers(row[3])]
    assert sorted(stated) == sorted(claim["id"] for claim in paper["claims"])
    scenes = set()
    for row in table:
        scene = ""
        for name in quoted(row[1]):  # a scene, with or without a sampling, or one more sampling
            sampling = name
            if "/" in name or name in paper["scenes"]:
                scene, _, sampling = name.partition("/")
            assert not sampling or sampling in paper["scenes"][scene]["samplings"], name
            scenes.add(scene)
    assert scenes == set(paper["scenes"])


def test_timings_are_all_listed(paper):
    section = README[README.index("### What is the same") :].split("\n## ")[0]
    drawn = [
        figure["name"].partition("_")[0]
        for scene in paper["scenes"].values()
        for figure in scene["figures"]
        if figure["kind"] == "acceleration"
    ]
    assert re.findall(r"[A-Z\d]\.\d+", section) == drawn
    timed = [
        claim["id"]
        for claim in claims.resolve(paper)
        if any("cpu_time" in place for one in claim["criterion"] for place in one["files"])
    ]
    assert re.findall(r"[A-Z]\d\d", section) == timed


def test_the_reference_is_in_step():
    made = runpy.run_path(str(ROOT / "docs" / "reference.py"))["reference"]()
    assert made == DOCUMENTS["docs/reference.md"], "make reference"


def test_every_rule_is_named():
    sources = [ROOT / "Snakefile", *(ROOT / "workflow" / "rules").glob("*.smk")]
    for source in sources:
        for rule in re.findall(
            r"^(?:use rule \w+ as|rule) (\w+)\b", source.read_text(encoding="utf-8"), re.M
        ):
            made = rule != "all" and not rule.startswith("unknown_")
            assert not made or f"`{rule}`" in README, rule


@pytest.mark.workflow
def test_every_rule_has_its_place_in_the_profile():
    profile = yaml.safe_load((ROOT / "profiles/slurm/config.yaml").read_text(encoding="utf-8"))
    run = subprocess.run(
        [sys.executable, "-m", "snakemake", "--list-rules"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    rules = {name for name in run.stdout.split() if not name.startswith("unknown_")}
    local = {"all", "lifted", "benchmarks", "stability", "surveys"}
    placed = set(profile["groups"]) | set(profile["set-resources"])
    assert placed <= rules - local
    # A study that is not named there is a job of the queue by itself.
    of_studies = {name for study in studies().values() for name in study.datasets}
    assert rules - local - placed <= of_studies
    timed = {name for name, given in profile["set-resources"].items() if "slurm_extra" in given}
    alone = {
        name for study in studies().values() for name, data in study.datasets.items() if data.alone
    }
    assert timed == alone | {"survey_cost"}, "profiles/slurm/config.yaml, set-resources"
    assert not timed & set(profile["groups"])


def test_pictures_are_small_and_of_figures(paper):
    drawn = {f["name"] for s in paper["scenes"].values() for f in s["figures"]}
    shown = re.findall(r"!\[[^\]]+\]\(docs/images/(.+)\.png\)", README)
    assert len(shown) == 3
    assert set(shown) <= drawn
    measured = DOCUMENTS["docs/performance.md"]
    shown += re.findall(r"!\[[^\]]+\]\(images/(benchmark_.+)\.png\)", measured)
    studied = DOCUMENTS["docs/stability.md"]
    shown += re.findall(r"!\[[^\]]+\]\(images/(stability_.+)\.png\)", studied)
    surveyed = DOCUMENTS["docs/parameter-studies.md"]
    shown += re.findall(r"!\[[^\]]+\]\(images/(survey_.+)\.png\)", surveyed)
    pictures = {path.stem: path for path in (ROOT / "docs" / "images").glob("*.png")}
    assert set(pictures) == set(shown)
    assert all(path.stat().st_size < 150_000 for path in pictures.values())


def test_versions_agree():
    newest = re.search(r"^## \[(.+?)\] - (.+)$", DOCUMENTS["CHANGELOG.md"], re.M)
    assert newest is not None
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert newest[1] == citation["version"] == sphpod.__version__
    assert newest[2] in (citation.get("date-released"), "unreleased")
