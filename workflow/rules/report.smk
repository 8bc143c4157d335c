"""Results are drawn, held against the paper, and told."""


rule figure:
    input:
        unpack(figure_inputs),
    output:
        pdf="<figures>/{name}.pdf",
        png=report(
            "<figures>/{name}.png",
            caption="../report/figure.rst",
            category=figure_category,
        ),
    log:
        "<logs>/figures/{name}.log",
    params:
        kind=lambda wildcards: ALL_FIGURES[wildcards.name]["kind"],
        options=figure_options,
        caption=lambda wildcards: ALL_FIGURES[wildcards.name]["caption"],
        code=code("figure.py"),
    message:
        "Figure {wildcards.name}"
    script:
        "../scripts/figure.py"


rule benchmark_figure:
    input:
        unpack(figure_inputs),
    output:
        pdf="<figures>/{name}.pdf",
        png=report(
            "<figures>/{name}.png",
            caption="../report/figure.rst",
            category=figure_category,
        ),
    log:
        "<logs>/figures/{name}.log",
    wildcard_constraints:
        name="|".join(BENCHMARK_FIGURES) or "none",
    params:
        kind=lambda wildcards: ALL_FIGURES[wildcards.name]["kind"],
        options={},
        caption=lambda wildcards: ALL_FIGURES[wildcards.name]["caption"],
        code=code("benchmark_figure.py"),
    message:
        "Figure {wildcards.name}"
    script:
        "../scripts/benchmark_figure.py"


ruleorder: benchmark_figure > figure


rule claims:
    input:
        [f"<results>/{path}" for path in claims.inputs(CLAIMS)],
    output:
        table="<results>/claims.csv",
        text="<results>/claims.md",
    log:
        "<logs>/claims.log",
    params:
        claims=CLAIMS,
        code=code("claims.py"),
    message:
        "Claims, each with its verdict"
    script:
        "../scripts/claims.py"


rule conventions:
    input:
        paper_inputs,
    output:
        conventions="<results>/conventions.csv",
        errors="<results>/reference_errors.csv",
    log:
        "<logs>/conventions.log",
    params:
        study=paper_study,
        code=code("conventions.py"),
    message:
        "Conventions: the paper's numbers with and without each"
    script:
        "../scripts/conventions.py"
