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
        name: SURVEYS[wildcards.survey][name]
        for name in names
        if name in SURVEYS[wildcards.survey]
    }


TRAINED_BY = "training", "quantities", "output_interval"
ANSWERED_BY = *TRAINED_BY, "mode_count", "tolerance"


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
    count = SURVEYS[wildcards.survey]["training"]["count"]
    return [f"<results>/surveys/{wildcards.survey}/training/{n}.nc" for n in range(count)]


def chunk_files(wildcards):
    count = survey_jobs.chunk_count(survey_physics(wildcards), SURVEYS[wildcards.survey])
    return [f"<results>/surveys/{wildcards.survey}/queries/{n}.nc" for n in range(count)]


def survey_files(survey):
    """All that a survey gives."""
    names = ["answers.csv", "quantiles.csv", "indices.csv", "responses.pdf", "responses.png"]
    names += ["histograms.pdf", "histograms.png"]
    if SURVEYS[survey]["validation"]:
        names += ["validation.csv", "errors.pdf", "errors.png"]
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
