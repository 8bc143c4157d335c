"""Results are drawn, put in tables, and compared with the paper."""


rule figure:
    input:
        unpack(figure_inputs),
    output:
        pdf="<figures>/{name}.pdf",
        png=report(
            "<figures>/{name}.png",
            caption="../report/figure.rst",
            category=figure_category,
            labels=figure_labels,
        ),
    log:
        "<logs>/figures/{name}.log",
    params:
        draw=drawing_function,
        options=figure_options,
        caption=figure_caption,
        code=lambda wildcards: provenance.digest(drawing_function(wildcards)),
    message:
        "Figure {wildcards.name}"
    script:
        "../scripts/figure.py"


rule animation:
    input:
        sph="<results>/{scene}/sph.nc",
        original="<results>/{scene}/{sampling}/original/k{modes}.nc",
        lifted="<results>/{scene}/{sampling}/lifted_exact/k{modes}.nc",
    output:
        "<figures>/{scene}/{sampling}/k{modes}.gif",
    log:
        "<logs>/figures/{scene}_{sampling}_k{modes}.log",
    wildcard_constraints:
        modes=r"[1-9]\d*",
    params:
        seconds=lambda wildcards: SCENES[wildcards.scene]["duration"] / 2,
        code=code("animation.py"),
    message:
        "{wildcards.scene}: motion with {wildcards.modes} modes of {wildcards.sampling}"
    script:
        "../scripts/animation.py"


rule page:
    input:
        "<results>/{table}.csv",
    output:
        report("<results>/{table}.html", category=page_category, labels={"table": "{table}"}),
    log:
        "<logs>/{table}_page.log",
    wildcard_constraints:
        table="|".join(PAGES),
    params:
        code=code("page.py"),
    message:
        "Table {wildcards.table} as a page"
    script:
        "../scripts/page.py"


rule errata:
    input:
        no_inputs_of_errata,
    output:
        "<results>/errata.csv",
    log:
        "<logs>/errata.log",
    params:
        page=os.path.relpath(ROOT / "docs" / "reproducing-the-paper.md"),
        text=lambda wildcards: errata_text(),
        code=code("errata.py"),
    message:
        "Errata of the paper in a table"
    script:
        "../scripts/errata.py"


rule thresholds:
    input:
        sweeps=full_sweeps("original", "lifted_euler") + study_sweeps(),
        errors=[f"<results>/{scene}/errors.nc" for scene in sampled_scenes()],
    output:
        "<results>/thresholds.csv",
    log:
        "<logs>/thresholds.log",
    params:
        code=code("thresholds.py"),
    message:
        "Mode counts from which each reduced model works"
    script:
        "../scripts/thresholds.py"


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
