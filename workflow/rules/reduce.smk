"""Full SPH is reduced: snapshots, their modes, and the models that live in these modes."""


rule snapshots:
    input:
        known_sampling,
        sph="<results>/{scene}/sph.nc",
    output:
        "<results>/{scene}/{sampling}/snapshots.nc",
    log:
        "<logs>/{scene}/{sampling}/snapshots.log",
    params:
        physics=physics,
        sampling=sampling_settings,
        code=code("snapshots.py"),
    message:
        "{wildcards.scene}: snapshots {wildcards.sampling}"
    script:
        "../scripts/snapshots.py"


rule pod:
    input:
        snapshots="<results>/{scene}/{sampling}/snapshots.nc",
    output:
        "<results>/{scene}/{sampling}/pod.nc",
    log:
        "<logs>/{scene}/{sampling}/pod.log",
    params:
        physics=physics,
        sampling=sampling_settings,
        code=code("pod.py"),
    message:
        "{wildcards.scene}: modes of the snapshots {wildcards.sampling}"
    script:
        "../scripts/pod.py"


rule reduced_model:
    input:
        known_reduced_model,
        pod="<results>/{scene}/{sampling}/pod.nc",
        sph="<results>/{scene}/sph.nc",
        reference=lambda wildcards: references(wildcards.scene)[0],
    output:
        "<results>/{scene}/{sampling}/{method}/k{modes}.nc",
    log:
        "<logs>/{scene}/{sampling}/{method}/k{modes}.log",
    wildcard_constraints:
        # Any other method, so that one that does not exist is refused by name.
        method=f"(?!({'|'.join(['lifted_euler', 'lifted_exact', *STUDIES_OF_MODES])})/)[^/]+",
    params:
        physics=physics,
        sampling=sampling_settings,
        mode_counts=lambda wildcards: parse_modes(wildcards.modes),
        code=code("reduced_model.py"),
    message:
        "{wildcards.scene}: {wildcards.method} reduced model with {wildcards.modes} modes of {wildcards.sampling}"
    script:
        "../scripts/reduced_model.py"


rule acceleration:
    input:
        known_study,
        pod="<results>/{scene}/{sampling}/pod.nc",
        sph="<results>/{scene}/sph.nc",
    output:
        "<results>/{scene}/{sampling}/acceleration.nc",
    log:
        "<logs>/{scene}/{sampling}/acceleration.log",
    params:
        physics=physics,
        sampling=sampling_settings,
        study=study_settings,
        code=code("acceleration.py"),
    message:
        "{wildcards.scene}: errors of the accelerated reduced models, snapshots {wildcards.sampling}"
    script:
        "../scripts/acceleration.py"
