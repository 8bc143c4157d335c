"""Models are timed, each job with the machine to itself. These results alone differ from run to
run, and what is computed from them: acceleration.csv, cpu_time.csv, skipping.csv, step_time.csv, the
figures of kind acceleration, work_precision and scaling, and the CPU-time rows of claims.csv and
claims.md."""


rule cpu_time:
    input:
        known_study,
        modes="<results>/{scene}/{sampling}/pod.nc",
    output:
        "<results>/{scene}/{sampling}/cpu_time.nc",
    log:
        "<logs>/{scene}/{sampling}/cpu_time.log",
    priority: 1  # one after another, before what could run beside them in pairs
    threads: lambda wildcards: workflow.cores or 1
    params:
        **computed(
            "studies.timing.compare",
            alone=True,
            of_sampling=True,
            n_freeze=lambda wildcards: study_settings(wildcards)["n_freeze"],
            mode_counts=lambda wildcards: study_settings(wildcards)["mode_counts"],
            repeats=CONFIG["benchmark"]["repeats"],
        ),
    message:
        "{wildcards.scene}: CPU times, snapshots {wildcards.sampling}"
    script:
        "../scripts/dataset.py"


use rule cpu_time as benchmark with:
    input:
        known_study,
        taken="<results>/{scene}/{sampling}/snapshots.nc",
        full="<results>/{scene}/sph.nc",
    output:
        "<results>/{scene}/{sampling}/benchmark.nc",
    log:
        "<logs>/{scene}/{sampling}/benchmark.log",
    priority: 0
    params:
        **computed(
            "studies.benchmark.compare",
            alone=True,
            of_sampling=True,
            sampling=sampling_settings,
            study=study_settings,
            repeats=CONFIG["benchmark"]["repeats"],
        ),
    message:
        "{wildcards.scene}: run time against error of every method, snapshots {wildcards.sampling}"


use rule benchmark as step_time with:
    input:
        known_scene,
    output:
        "<results>/{scene}/step_time.nc",
    log:
        "<logs>/{scene}/step_time.log",
    params:
        **computed(
            "studies.timing.compare_steps",
            alone=True,
            repeats=CONFIG["benchmark"]["repeats"],
        ),
    message:
        "{wildcards.scene}: CPU time of a step of full SPH"


use rule benchmark as scaling with:
    input:
        known_benchmark,
    output:
        "<results>/{scene}/scaling.nc",
    log:
        "<logs>/{scene}/scaling.log",
    params:
        **computed(
            "studies.scaling.measure",
            alone=True,
            particle_counts=CONFIG["benchmark"]["particle_counts"],
            mode_counts=CONFIG["benchmark"]["mode_counts"],
            repeats=CONFIG["benchmark"]["repeats"],
        ),
    message:
        "{wildcards.scene}: time and memory of a step against particles and modes"


use rule benchmark as skipping with:
    input:
        known_benchmark,
    output:
        "<results>/{scene}/skipping.nc",
    log:
        "<logs>/{scene}/skipping.log",
    params:
        **computed(
            "studies.skipping.measure",
            alone=True,
            repeats=CONFIG["benchmark"]["repeats"],
        ),
    message:
        "{wildcards.scene}: what it saves to leave out what is not needed"


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
