"""Surveys of parameters: training runs, the modes they share, queries in chunks, and what they say."""


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


use rule survey_validation as survey_model with:
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


use rule survey_validation as survey_queries with:
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


use rule survey_validation as survey_answers with:
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


use rule survey_validation as survey_design with:
    input:
        unpack(design_inputs),
    output:
        f"{SURVEY}/design.nc",
    log:
        "<logs>/surveys/{survey}/design.log",
    params:
        **of_survey("designed", (*ANSWERED_BY, "queries", "design")),
    message:
        "Survey {wildcards.survey}: design by optimisation"


use rule survey_validation as survey_indices with:
    output:
        f"{SURVEY}/indices.nc",
    log:
        "<logs>/surveys/{survey}/indices.log",
    params:
        **of_survey("shared_out", (*ANSWERED_BY, "sobol_samples")),
    message:
        "Survey {wildcards.survey}: Sobol indices"


use rule survey_validation as survey_cost with:
    output:
        f"{SURVEY}/cost.nc",
    log:
        "<logs>/surveys/{survey}/cost.log",
    # With nothing beside it.
    priority: 1
    threads: lambda wildcards: workflow.cores or 1
    params:
        **of_survey("timed", (*ANSWERED_BY, "queries", "cost_repeats"), alone=True),
    message:
        "Survey {wildcards.survey}: costs of queries and of the training"


use rule survey_validation as survey_sections with:
    output:
        f"{SURVEY}/sections.nc",
    log:
        "<logs>/surveys/{survey}/sections.log",
    params:
        **of_survey("sections", ANSWERED_BY),
    message:
        "Survey {wildcards.survey}: quantities along each parameter"


use rule survey_validation as survey_surfaces with:
    input:
        model=f"{SURVEY}/model.nc",
        sections=f"{SURVEY}/sections.nc",
    output:
        f"{SURVEY}/surfaces.nc",
    log:
        "<logs>/surveys/{survey}/surfaces.log",
    params:
        **of_survey("surfaces", ANSWERED_BY),
    message:
        "Survey {wildcards.survey}: quantities over two parameters"


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
        png=report(
            f"{SURVEY}/{{drawing}}.png",
            caption="../report/survey_figure.rst",
            category="Surveys",
            labels={"survey": "{survey}", "kind": "{drawing}"},
        ),
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
