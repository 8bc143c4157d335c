"""Models are timed, each job with the machine to itself. These results alone differ from run to
run, and what is computed from them: cpu_time.csv, performance.csv, the figures of kind
acceleration, and the CPU-time rows of claims.csv."""


rule cpu_time:
    input:
        known_study,
        pod="<results>/{scene}/{sampling}/pod.nc",
    output:
        "<results>/{scene}/{sampling}/cpu_time.nc",
    log:
        "<logs>/{scene}/{sampling}/cpu_time.log",
    threads: workflow.cores
    params:
        study=study_settings,
        repeats=CONFIG["benchmark"]["repeats"],
        code=code("cpu_time.py"),
    message:
        "{wildcards.scene}: CPU times, snapshots {wildcards.sampling}"
    script:
        "../scripts/cpu_time.py"


rule cpu_time_table:
    input:
        studies("cpu_time.nc"),
    output:
        "<results>/cpu_time.csv",
    log:
        "<logs>/cpu_time_table.log",
    params:
        code=code("cpu_time_table.py"),
    message:
        "CPU times and savings of all studies"
    script:
        "../scripts/cpu_time_table.py"
