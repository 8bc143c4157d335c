"""Studies are computed, put in tables and drawn, each as its module declares
(`sphpod/studies/study.py`). Rules have the names of the datasets. What is timed has the machine to
itself; these results alone differ from run to run, and what is computed from them."""

for word, study in STUDIES.items():
    for name, data in study.datasets.items():

        rule:
            name:
                name
            input:
                unpack(inputs_of(data)),
            output:
                path_of(name, wildcards_of(data)),
            log:
                path_of(name, wildcards_of(data), "<logs>", "log"),
            wildcard_constraints:
                modes=r"[1-9]\d*",
            # Each alone, before what could run beside it in pairs.
            priority: int(data.alone)
            threads: lambda wildcards, data=data: (workflow.cores or 1) if data.alone else 1
            params:
                **computed(
                    data.compute,
                    data.alone,
                    data.of_sampling,
                    scenes=scenes_of(data),
                    **arguments_of(data),
                ),
            message:
                data.message.replace("{", "{wildcards.")
            script:
                "../scripts/dataset.py"


rule table:
    input:
        lambda wildcards: TABLES[wildcards.table][1],
    output:
        "<results>/{table}.csv",
    log:
        "<logs>/{table}_table.log",
    wildcard_constraints:
        table="|".join(TABLES),
    params:
        rows=lambda wildcards: TABLES[wildcards.table][0],
        code=lambda wildcards: provenance.digest(TABLES[wildcards.table][0]),
    message:
        "Study in a table, {wildcards.table}"
    script:
        "../scripts/table.py"
