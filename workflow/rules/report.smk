"""Results are drawn and told."""


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
        kind=lambda wildcards: FIGURES[wildcards.name]["kind"],
        options=figure_options,
        caption=lambda wildcards: FIGURES[wildcards.name]["caption"],
        code=code("figure.py"),
    message:
        "Figure {wildcards.name}"
    script:
        "../scripts/figure.py"
