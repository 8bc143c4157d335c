"""Stability is predicted by theory, measured, and put to the test by trying to break it."""


rule time_steps:
    input:
        known_scene,
    output:
        "<results>/{scene}/time_steps.nc",
    log:
        "<logs>/{scene}/time_steps.log",
    params:
        physics=physics,
        code=code("time_steps.py"),
    message:
        "{wildcards.scene}: largest stable time steps of full models"
    script:
        "../scripts/time_steps.py"


rule reduced_time_steps:
    input:
        known_sampling,
        pod="<results>/{scene}/{sampling}/pod.nc",
        lifted_pod="<results>/{scene}/{sampling}/lifted_pod.nc",
    output:
        "<results>/{scene}/{sampling}/time_steps.nc",
    log:
        "<logs>/{scene}/{sampling}/time_steps.log",
    params:
        physics=physics,
        sampling=sampling_settings,
        mode_counts=stability_modes,
        code=code("reduced_time_steps.py"),
    message:
        "{wildcards.scene}: largest stable time steps of reduced models, snapshots {wildcards.sampling}"
    script:
        "../scripts/reduced_time_steps.py"


rule damping_map:
    input:
        known_scene,
    output:
        "<results>/{scene}/stability_map.nc",
    log:
        "<logs>/{scene}/stability_map.log",
    params:
        physics=physics,
        code=code("damping_map.py"),
    message:
        "{wildcards.scene}: stability against damping and time step"
    script:
        "../scripts/damping_map.py"


rule mode_map:
    input:
        known_sampling,
        pod="<results>/{scene}/{sampling}/pod.nc",
        lifted_pod="<results>/{scene}/{sampling}/lifted_pod.nc",
    output:
        "<results>/{scene}/{sampling}/stability_map.nc",
    log:
        "<logs>/{scene}/{sampling}/stability_map.log",
    params:
        physics=physics,
        sampling=sampling_settings,
        mode_counts=all_modes,
        code=code("mode_map.py"),
    message:
        "{wildcards.scene}: stability against modes and time step, snapshots {wildcards.sampling}"
    script:
        "../scripts/mode_map.py"


rule growth:
    input:
        known_undamped,
    output:
        "<results>/{scene}/growth.nc",
    log:
        "<logs>/{scene}/growth.log",
    params:
        physics=physics,
        horizon_factors=CONFIG["stability"]["horizon_factors"],
        energy_horizon_factor=CONFIG["stability"]["energy_horizon_factor"],
        code=code("growth.py"),
    message:
        "{wildcards.scene}: growth of the energy over long times"
    script:
        "../scripts/growth.py"


rule operators:
    input:
        known_sampling,
        pod="<results>/{scene}/{sampling}/pod.nc",
        lifted_pod="<results>/{scene}/{sampling}/lifted_pod.nc",
        snapshots="<results>/{scene}/{sampling}/snapshots.nc",
    output:
        "<results>/{scene}/{sampling}/operators.nc",
    log:
        "<logs>/{scene}/{sampling}/operators.log",
    params:
        physics=physics,
        sampling=sampling_settings,
        mode_counts=all_modes,
        code=code("operators.py"),
    message:
        "{wildcards.scene}: spectra of reduced operators, snapshots {wildcards.sampling}"
    script:
        "../scripts/operators.py"


rule random_bases:
    input:
        known_scene,
    output:
        "<results>/{scene}/random_bases.nc",
    log:
        "<logs>/{scene}/random_bases.log",
    params:
        physics=physics,
        bases=CONFIG["stability"]["random_bases"],
        seed=seed_of_scene,
        code=code("random_bases.py"),
    message:
        "{wildcards.scene}: spectra of reduced operators of random bases"
    script:
        "../scripts/random_bases.py"


rule random_run:
    input:
        known_undamped,
    output:
        "<results>/{scene}/random_run.nc",
    log:
        "<logs>/{scene}/random_run.log",
    params:
        physics=physics,
        code=code("random_run.py"),
    message:
        "{wildcards.scene}: a run of random modes that grows"
    script:
        "../scripts/random_run.py"


rule long_run:
    input:
        known_sampling,
        known_undamped,
        pod="<results>/{scene}/{sampling}/pod.nc",
        lifted_pod="<results>/{scene}/{sampling}/lifted_pod.nc",
    output:
        "<results>/{scene}/{sampling}/long_run/k{modes}.nc",
    log:
        "<logs>/{scene}/{sampling}/long_run/k{modes}.log",
    wildcard_constraints:
        modes=r"[1-9]\d*",
    params:
        physics=physics,
        sampling=sampling_settings,
        horizon_factor=max(CONFIG["stability"]["horizon_factors"]),
        code=code("long_run.py"),
    message:
        "{wildcards.scene}: a long run with {wildcards.modes} modes of {wildcards.sampling}"
    script:
        "../scripts/long_run.py"


rule smoothing:
    input:
        known_scene,
        reference=lambda wildcards: truth(wildcards.scene),
    output:
        "<results>/{scene}/smoothing.nc",
    log:
        "<logs>/{scene}/smoothing.log",
    params:
        physics=physics,
        smoothing_ratios=CONFIG["stability"]["smoothing_ratios"],
        code=code("smoothing.py"),
    message:
        "{wildcards.scene}: smoothing lengths compared"
    script:
        "../scripts/smoothing.py"


rule amplitude:
    input:
        known_sampling,
    output:
        "<results>/{scene}/{sampling}/amplitude.nc",
    log:
        "<logs>/{scene}/{sampling}/amplitude.log",
    params:
        physics=physics,
        sampling=sampling_settings,
        mode_counts=stability_modes,
        amplitude_count=CONFIG["stability"]["amplitude_count"],
        code=code("amplitude.py"),
    message:
        "{wildcards.scene}: all models until the line folds, snapshots {wildcards.sampling}"
    script:
        "../scripts/amplitude.py"


rule poor_snapshots:
    input:
        known_sampling,
        snapshots="<results>/{scene}/{sampling}/snapshots.nc",
        full="<results>/{scene}/lifted_full.nc",
    output:
        "<results>/{scene}/{sampling}/poor_snapshots.nc",
    log:
        "<logs>/{scene}/{sampling}/poor_snapshots.log",
    params:
        physics=physics,
        sampling=sampling_settings,
        mode_counts=stability_modes,
        noise_levels=CONFIG["stability"]["noise_levels"],
        code=code("poor_snapshots.py"),
    message:
        "{wildcards.scene}: models of poor snapshots, from {wildcards.sampling}"
    script:
        "../scripts/poor_snapshots.py"


rule edge_scene:
    input:
        known_edge_scene,
    output:
        "<results>/{scene}/edge_scene.nc",
    log:
        "<logs>/{scene}/edge_scene.log",
    params:
        physics=lambda wildcards: CONFIG["stability"]["scenes"][wildcards.scene],
        code=code("edge_scene.py"),
    message:
        "{wildcards.scene}: what must hold of a scene at the edge"
    script:
        "../scripts/edge_scene.py"


rule machine:
    input:
        known_sampling,
        snapshots="<results>/{scene}/{sampling}/snapshots.nc",
    output:
        "<results>/{scene}/{sampling}/machine.nc",
    log:
        "<logs>/{scene}/{sampling}/machine.log",
    threads: lambda wildcards: workflow.cores
    params:
        physics=physics,
        sampling=sampling_settings,
        code=code("machine.py"),
    message:
        "{wildcards.scene}: the same on one thread and core as on more, snapshots {wildcards.sampling}"
    script:
        "../scripts/machine.py"


rule detection:
    input:
        known_even,
    output:
        "<results>/{scene}/detection.nc",
    log:
        "<logs>/{scene}/detection.log",
    threads: lambda wildcards: workflow.cores
    params:
        physics=physics,
        repeats=CONFIG["benchmark"]["repeats"],
        code=code("detection.py"),
    message:
        "{wildcards.scene}: what it costs to watch for a breakdown"
    script:
        "../scripts/detection.py"


rule stability_table:
    input:
        lambda wildcards: STABILITY[wildcards.table],
    output:
        "<results>/{table}.csv",
    log:
        "<logs>/{table}_table.log",
    wildcard_constraints:
        table="|".join(STABILITY),
    params:
        table=lambda wildcards: wildcards.table,
        code=code("stability_table.py"),
    message:
        "Stability in a table, {wildcards.table}"
    script:
        "../scripts/stability_table.py"


rule stability_figure:
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
        name="|".join(STABILITY_FIGURES),
    params:
        kind=lambda wildcards: ALL_FIGURES[wildcards.name]["kind"],
        options={},
        caption=lambda wildcards: ALL_FIGURES[wildcards.name]["caption"],
        code=code("stability_figure.py"),
    message:
        "Figure {wildcards.name}"
    script:
        "../scripts/stability_figure.py"


ruleorder: stability_figure > figure
