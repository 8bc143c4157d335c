"""Models are timed, each job with the machine to itself. These results alone differ from run to
run, and what is computed from them: cpu_time.csv, step_time.csv, the figures of kind
acceleration, and the CPU-time rows of claims.csv and claims.md."""


rule cpu_time:
    input:
        known_study,
        pod="<results>/{scene}/{sampling}/pod.nc",
    output:
        "<results>/{scene}/{sampling}/cpu_time.nc",
    log:
        "<logs>/{scene}/{sampling}/cpu_time.log",
    priority: 1  # one after another, before what could run beside them in pairs
    threads: lambda wildcards: workflow.cores
    params:
        study=study_settings,
        repeats=CONFIG["benchmark"]["repeats"],
        code=code("cpu_time.py"),
    message:
        "{wildcards.scene}: CPU times, snapshots {wildcards.sampling}"
    script:
        "../scripts/cpu_time.py"


rule step_time:
    input:
        known_scene,
    output:
        "<results>/{scene}/step_time.nc",
    log:
        "<logs>/{scene}/step_time.log",
    threads: lambda wildcards: workflow.cores
    params:
        physics=physics,
        repeats=CONFIG["benchmark"]["repeats"],
        code=code("step_time.py"),
    message:
        "{wildcards.scene}: CPU time of a step of full SPH"
    script:
        "../scripts/step_time.py"


rule cpu_time_table:
    input:
        lambda wildcards: {"cpu_time": studies("cpu_time.nc"), "step_time": step_times()}[
            wildcards.kind
        ],
    output:
        "<results>/{kind}.csv",
    log:
        "<logs>/{kind}_table.log",
    wildcard_constraints:
        kind="cpu_time|step_time",
    params:
        kind=lambda wildcards: wildcards.kind,
        code=code("cpu_time_table.py"),
    message:
        "CPU times in a table, {wildcards.kind}"
    script:
        "../scripts/cpu_time_table.py"
