"""Models are timed, each job with the machine to itself. These results alone differ from run to
run, and what is computed from them: acceleration.csv, cpu_time.csv, skipping.csv, step_time.csv, the
figures of kind acceleration, work_precision and scaling, and the CPU-time rows of claims.csv and
claims.md."""


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
        physics=physics,
        sampling=sampling_settings,
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


rule benchmark:
    input:
        known_study,
        snapshots="<results>/{scene}/{sampling}/snapshots.nc",
        sph="<results>/{scene}/sph.nc",
    output:
        "<results>/{scene}/{sampling}/benchmark.nc",
    log:
        "<logs>/{scene}/{sampling}/benchmark.log",
    threads: lambda wildcards: workflow.cores
    params:
        physics=physics,
        sampling=sampling_settings,
        study=study_settings,
        repeats=CONFIG["benchmark"]["repeats"],
        code=code("benchmark.py"),
    message:
        "{wildcards.scene}: run time against error of every method, snapshots {wildcards.sampling}"
    script:
        "../scripts/benchmark.py"


rule scaling:
    input:
        known_benchmark,
    output:
        "<results>/{scene}/scaling.nc",
    log:
        "<logs>/{scene}/scaling.log",
    threads: lambda wildcards: workflow.cores
    params:
        physics=physics,
        benchmark=CONFIG["benchmark"],
        code=code("scaling.py"),
    message:
        "{wildcards.scene}: time and memory of a step against particles and modes"
    script:
        "../scripts/scaling.py"


rule skipping:
    input:
        known_benchmark,
    output:
        "<results>/{scene}/skipping.nc",
    log:
        "<logs>/{scene}/skipping.log",
    threads: lambda wildcards: workflow.cores
    params:
        physics=physics,
        repeats=CONFIG["benchmark"]["repeats"],
        code=code("skipping.py"),
    message:
        "{wildcards.scene}: what it saves to leave out what is not needed"
    script:
        "../scripts/skipping.py"


rule timing_table:
    input:
        lambda wildcards: {
            "acceleration": studies("cpu_time.nc"),
            "cpu_time": studies("benchmark.nc"),
            "skipping": of_step_scene("skipping.nc"),
            "step_time": of_step_scene("step_time.nc"),
        }[wildcards.kind],
    output:
        "<results>/{kind}.csv",
    log:
        "<logs>/{kind}_table.log",
    wildcard_constraints:
        kind="acceleration|cpu_time|skipping|step_time",
    params:
        kind=lambda wildcards: wildcards.kind,
        code=code("timing_table.py"),
    message:
        "Measured times in a table, {wildcards.kind}"
    script:
        "../scripts/timing_table.py"
