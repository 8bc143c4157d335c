"""What surveys there are, what they read, and what their rules pass to scripts."""

SURVEY = "<results>/surveys/{survey}"


def survey_scene(wildcards):
    """Name of the scene of a survey, once it is known that there is what a target names."""
    known("survey", wildcards.survey, SURVEYS)
    return SURVEYS[wildcards.survey]["scene"]


def survey_physics(wildcards):
    """Settings of the scene that a survey depends on: those of its motion, with all ranges."""
    scene = SCENES[survey_scene(wildcards)]
    return samples.survey_settings(scene, SURVEYS[wildcards.survey])


def survey_keys(*names):
    """Those settings of a survey, of which its results depend on these alone."""

    def given(wildcards):
        survey = SURVEYS[wildcards.survey]
        found = {name: survey[name] for name in names if name in survey}
        if "from" in found.get("queries", ()):
            # A table that has been edited asks for other queries.
            content = Path(found["queries"]["from"]).read_bytes()
            found["table"] = hashlib.sha256(content).hexdigest()
        return found

    return given


TRAINED_BY = "training", "output_interval"
ANSWERED_BY = *TRAINED_BY, "mode_count", "tolerance", "quantities"


def of_survey(compute, keys, alone=False, **arguments):
    """What is passed to the script of a survey, its function and what that is given, and a digest."""
    return {
        "compute": compute,
        "code": lambda wildcards: provenance.digest(f"surveys.jobs.{compute}"),
        "alone": alone,
        "scene": survey_scene,
        "physics": survey_physics,
        "survey": survey_keys(*keys),
        "arguments": lambda wildcards: {
            name: int(wildcards[wildcard]) for name, wildcard in arguments.items()
        },
    }


def training_files(wildcards):
    known("survey", wildcards.survey, SURVEYS)
    training = SURVEYS[wildcards.survey]["training"]
    # Greedy runs follow from one another, in the job of the modes.
    count = training["count"] if training["method"] == "sobol" else 0
    return [f"<results>/surveys/{wildcards.survey}/training/{n}.nc" for n in range(count)]


def design_inputs(wildcards):
    """What a design begins with: the modes, the queries, and runs to train with once more."""
    designed = [name for name, survey in SURVEYS.items() if "design" in survey]
    known("survey with a design", wildcards.survey, designed)
    folder = f"<results>/surveys/{wildcards.survey}"
    return {
        "model": f"{folder}/model.nc",
        "answers": f"{folder}/answers.nc",
        "runs": training_files(wildcards),
    }


def chunk_files(wildcards):
    count = survey_jobs.chunk_count(survey_physics(wildcards), SURVEYS[wildcards.survey])
    return [f"<results>/surveys/{wildcards.survey}/queries/{n}.nc" for n in range(count)]


SURVEY_TABLES = {
    "answers": "answers.nc",
    "quantiles": "answers.nc",
    "design": "design.nc",
    "indices": "indices.nc",
    "validation": "validation.nc",
    "cost": "cost.nc",
}
SURVEY_FIGURES = {
    "responses": "answers",
    "sections": "sections",
    "surfaces": "surfaces",
    "histograms": "answers",
    "design": "design",
    "indices": "indices",
    "errors": "validation",
    "cost": "cost",
}


def drawn_of_survey(wildcards):
    """What a figure of a survey shows."""
    known("survey", wildcards.survey, SURVEYS)
    shown = SURVEY_FIGURES[wildcards.drawing]
    return {shown: f"<results>/surveys/{wildcards.survey}/{shown}.nc"}


def survey_numbers(survey):
    """Quantities of a survey that are numbers, each with its label."""
    units = {"velocity": "m/s", "strain": "", "stress": "Pa"}
    found = {}
    for name, asked in SURVEYS[survey]["quantities"].items():
        unit = "J/m²" if "energy" in asked["kind"] else units.get(asked.get("field"), "")
        unit = "s" if asked["kind"] == "passage" else unit
        if asked["kind"] != "history":
            found[name] = f"{name} [{unit}]" if unit else name
    return found


def survey_options(wildcards):
    """Arguments of the plotting function that are not inputs."""
    survey = SURVEYS[wildcards.survey]
    options = {
        "parameters": SCENES[survey["scene"]]["parameters"],
        "quantities": survey_numbers(wildcards.survey),
        "tolerance": survey["tolerance"],
        "keys": survey.get("design"),
        "labels": survey_numbers(wildcards.survey),
    }
    asked = {
        "design": ("keys", "labels"),
        "responses": ("parameters", "quantities"),
        "sections": ("parameters", "quantities"),
        "surfaces": ("parameters", "quantities"),
        "histograms": ("quantities",),
        "errors": ("tolerance",),
    }
    return {name: options[name] for name in asked.get(wildcards.drawing, ())}


def survey_files(survey):
    """All that a survey gives."""
    drawn, tables = [], ["answers", "quantiles"]
    if survey_numbers(survey):
        drawn += ["responses", "sections", "histograms"]
    if survey_numbers(survey) and len(SCENES[SURVEYS[survey]["scene"]]["parameters"]) > 1:
        drawn += ["surfaces"]
    if survey_numbers(survey) and SURVEYS[survey]["sobol_samples"]:
        drawn, tables = [*drawn, "indices"], [*tables, "indices"]
    if SURVEYS[survey]["validation"]:
        drawn, tables = [*drawn, "errors"], [*tables, "validation"]
    if SURVEYS[survey]["cost_repeats"]:
        drawn, tables = [*drawn, "cost"], [*tables, "cost"]
    if "design" in SURVEYS[survey]:
        drawn, tables = [*drawn, "design"], [*tables, "design"]
    names = [f"{name}.csv" for name in tables]
    names += [f"{name}.{form}" for name in drawn for form in ("pdf", "png")]
    return [f"<results>/surveys/{survey}/{name}" for name in names]
