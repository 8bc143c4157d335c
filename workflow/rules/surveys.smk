"""Surveys of parameters: training runs, the modes they share, queries in chunks, and what they say."""

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
    return lambda wildcards: {
        name: SURVEYS[wildcards.survey][name] for name in names if name in SURVEYS[wildcards.survey]
    }


TRAINED_BY = "training", "output_interval"
ANSWERED_BY = *TRAINED_BY, "mode_count", "tolerance", "quantities"


def of_survey(compute, keys, **arguments):
    """Parameters of a rule of a survey: its function, what that is given, and the code's digest."""
    return {
        "compute": compute,
        "code": lambda wildcards: provenance.digest(f"surveys.jobs.{compute}"),
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


def chunk_files(wildcards):
    count = survey_jobs.chunk_count(survey_physics(wildcards), SURVEYS[wildcards.survey])
    return [f"<results>/surveys/{wildcards.survey}/queries/{n}.nc" for n in range(count)]


SURVEY_TABLES = {
    "answers": "answers.nc",
    "quantiles": "answers.nc",
    "indices": "indices.nc",
    "validation": "validation.nc",
}
SURVEY_FIGURES = {
    "responses": "answers",
    "histograms": "answers",
    "indices": "indices",
    "errors": "validation",
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
    }
    asked = {
        "responses": ("parameters", "quantities"),
        "histograms": ("quantities",),
        "errors": ("tolerance",),
    }
    return {name: options[name] for name in asked.get(wildcards.drawing, ())}


def survey_files(survey):
    """All that a survey gives."""
    drawn, tables = [], ["answers", "quantiles"]
    if survey_numbers(survey):
        drawn += ["responses", "histograms"]
    if survey_numbers(survey) and SURVEYS[survey]["sobol_samples"]:
        drawn, tables = [*drawn, "indices"], [*tables, "indices"]
    if SURVEYS[survey]["validation"]:
        drawn, tables = [*drawn, "errors"], [*tables, "validation"]
    names = [f"{name}.csv" for name in tables]
    names += [f"{name}.{form}" for name in drawn for form in ("pdf", "png")]
    return [f"<results>/surveys/{survey}/{name}" for name in names]


rule survey_training:
    output:
        f"{SURVEY}/training/{{run}}.nc",
    log:
        "<logs>/surveys/{survey}/training_{run}.log",
    wildcard_constraints:
        run=r"\d+",
    params:
        **of_survey("training_run", TRAINED_BY, number="run"),
    message:
        "Survey {wildcards.survey}: training run {wildcards.run}"
    script:
        "../scripts/survey.py"


rule survey_model:
    input:
        runs=training_files,
    output:
        f"{SURVEY}/model.nc",
    log:
        "<logs>/surveys/{survey}/model.log",
    params:
        **of_survey("model", ANSWERED_BY),
    message:
        "Survey {wildcards.survey}: shared modes"
    script:
        "../scripts/survey.py"


rule survey_queries:
    input:
        model=f"{SURVEY}/model.nc",
    output:
        f"{SURVEY}/queries/{{chunk}}.nc",
    log:
        "<logs>/surveys/{survey}/queries_{chunk}.log",
    wildcard_constraints:
        chunk=r"\d+",
    params:
        **of_survey("queries", (*ANSWERED_BY, "queries", "chunk_size"), chunk="chunk"),
    message:
        "Survey {wildcards.survey}: queries, chunk {wildcards.chunk}"
    script:
        "../scripts/survey.py"


rule survey_answers:
    input:
        chunks=chunk_files,
    output:
        f"{SURVEY}/answers.nc",
    log:
        "<logs>/surveys/{survey}/answers.log",
    params:
        **of_survey("answers", (*ANSWERED_BY, "queries")),
    message:
        "Survey {wildcards.survey}: all queries"
    script:
        "../scripts/survey.py"


rule survey_validation:
    input:
        model=f"{SURVEY}/model.nc",
    output:
        f"{SURVEY}/validation.nc",
    log:
        "<logs>/surveys/{survey}/validation.log",
    params:
        **of_survey("validated", (*ANSWERED_BY, "validation")),
    message:
        "Survey {wildcards.survey}: random queries solved in full"
    script:
        "../scripts/survey.py"


rule survey_indices:
    input:
        model=f"{SURVEY}/model.nc",
    output:
        f"{SURVEY}/indices.nc",
    log:
        "<logs>/surveys/{survey}/indices.log",
    params:
        **of_survey("shared_out", (*ANSWERED_BY, "sobol_samples")),
    message:
        "Survey {wildcards.survey}: Sobol indices"
    script:
        "../scripts/survey.py"


rule survey_table:
    input:
        lambda wildcards: f"{SURVEY}/{SURVEY_TABLES[wildcards.table]}".format(**wildcards),
    output:
        f"{SURVEY}/{{table}}.csv",
    log:
        "<logs>/surveys/{survey}/{table}_table.log",
    wildcard_constraints:
        table="|".join(SURVEY_TABLES),
    params:
        rows=lambda wildcards: wildcards.table,
        code=lambda wildcards: provenance.digest(f"surveys.tables.{wildcards.table}"),
    message:
        "Survey {wildcards.survey}: table of {wildcards.table}"
    script:
        "../scripts/survey_table.py"


rule survey_figure:
    input:
        unpack(drawn_of_survey),
    output:
        pdf=f"{SURVEY}/{{drawing}}.pdf",
        png=f"{SURVEY}/{{drawing}}.png",
    log:
        "<logs>/surveys/{survey}/{drawing}_figure.log",
    wildcard_constraints:
        drawing="|".join(SURVEY_FIGURES),
    params:
        draw=lambda wildcards: f"figures.survey_plots.{wildcards.drawing}",
        options=survey_options,
        code=lambda wildcards: provenance.digest(f"figures.survey_plots.{wildcards.drawing}"),
    message:
        "Survey {wildcards.survey}: figure of {wildcards.drawing}"
    script:
        "../scripts/figure.py"
