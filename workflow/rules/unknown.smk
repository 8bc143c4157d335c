"""What no rule makes is refused by name, with what is made in its place."""


rule unknown_of_all:
    input:
        lambda wildcards: unknown(wildcards),
    output:
        "<results>/{file}",
    wildcard_constraints:
        file=other_than(files_made()),


rule unknown_of_scene:
    input:
        lambda wildcards: unknown(wildcards, "{scene}"),
    output:
        "<results>/{scene}/{file}",
    wildcard_constraints:
        file=other_than(files_made("{scene}")),


rule unknown_of_sampling:
    input:
        lambda wildcards: unknown(wildcards, "{scene}", "{sampling}"),
    output:
        "<results>/{scene}/{sampling}/{file}",
    wildcard_constraints:
        file=other_than(files_made("{scene}", "{sampling}")),


rule unknown_of_method:
    input:
        lambda wildcards: unknown(wildcards, "{scene}", "{sampling}", "{method}"),
    output:
        "<results>/{scene}/{sampling}/{method}/{file}",
    wildcard_constraints:
        file=other_than(files_made("{scene}", "{sampling}", "{method}")),


rule unknown_figure:
    input:
        lambda wildcards: known("figure", wildcards.file, [f"{name}.pdf" for name in ALL_FIGURES]),
    output:
        "<figures>/{file}",
    wildcard_constraints:
        file=r"[^/]+(?<!\.pdf)(?<!\.png)",


rule unknown_target:
    input:
        lambda wildcards: known("target", wildcards.target, TARGETS),
    output:
        "{target}",
    wildcard_constraints:
        target=f"(?!({'|'.join(TARGETS)})$)[a-z_]+",
