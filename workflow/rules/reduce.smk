"""Full SPH is reduced: snapshots, their modes, and the models that live in these modes."""


use rule reference as snapshots with:
    input:
        unpack(snapshot_inputs),
    output:
        "<results>/{scene}/{sampling}/snapshots.nc",
    log:
        "<logs>/{scene}/{sampling}/snapshots.log",
    params:
        **computed(
            lambda wildcards: (
                "reduced.snapshots.own" if is_own(wildcards) else "reduced.rounding.sampled"
            ),
            all_times=True,
            of_sampling=True,
            sampling=sampling_settings,
        ),
    message:
        "{wildcards.scene}: snapshots {wildcards.sampling}"


use rule reference as pod with:
    input:
        unpack(mode_inputs),
    output:
        "<results>/{scene}/{sampling}/pod.nc",
    log:
        "<logs>/{scene}/{sampling}/pod.log",
    params:
        **computed(
            lambda wildcards: (
                "reduced.joined.decompose" if lenders(wildcards) else "reduced.pod.decompose"
            ),
            of_sampling=True,
        ),
    message:
        "{wildcards.scene}: modes of the snapshots {wildcards.sampling}"


use rule pod as lifted_pod with:
    output:
        "<results>/{scene}/{sampling}/lifted_pod.nc",
    log:
        "<logs>/{scene}/{sampling}/lifted_pod.log",
    params:
        **computed(
            lambda wildcards: (
                "reduced.joined.decompose_lifted"
                if lenders(wildcards)
                else "reduced.lifted_rom.decompose"
            ),
            of_sampling=True,
            sources=lending_scenes,
        ),
    message:
        "{wildcards.scene}: energy modes of the snapshots {wildcards.sampling}"


use rule reference as reduced_model with:
    input:
        known_reduced_model,
        modes="<results>/{scene}/{sampling}/pod.nc",
        sph="<results>/{scene}/sph.nc",
        reference=lambda wildcards: references(wildcards.scene)[0],
    output:
        "<results>/{scene}/{sampling}/{method}/k{modes}.nc",
    log:
        "<logs>/{scene}/{sampling}/{method}/k{modes}.log",
    wildcard_constraints:
        # Any other method, so that one that does not exist is refused by name.
        method=f"(?!({'|'.join([*LIFTED_METHODS, *STUDIES_OF_MODES])})/)[^/]+",
    params:
        **computed(
            lambda wildcards: (
                "reduced.rom.sweep_pair" if parse_pair(wildcards.modes) else "reduced.rom.sweep"
            ),
            of_sampling=True,
            method=lambda wildcards: wildcards.method,
            mode_counts=lambda wildcards: (
                parse_pair(wildcards.modes) or parse_modes(wildcards.modes)
            ),
        ),
    message:
        "{wildcards.scene}: {wildcards.method} reduced model with {wildcards.modes} modes of {wildcards.sampling}"


use rule reduced_model as lifted_model with:
    input:
        known_reduced_model,
        modes="<results>/{scene}/{sampling}/lifted_pod.nc",
        full=lambda wildcards: lifted_from(wildcards.scene, wildcards.method),
        reference=lambda wildcards: references(wildcards.scene)[0],
    wildcard_constraints:
        method="|".join(LIFTED_METHODS),
    params:
        **computed(
            lambda wildcards: LIFTED_METHODS[wildcards.method],
            of_sampling=True,
            mode_counts=lambda wildcards: parse_modes(wildcards.modes),
        ),


rule lifted_tolerance:
    input:
        known_tolerance,
        pod="<results>/{scene}/{sampling}/lifted_pod.nc",
    output:
        "<results>/{scene}/{sampling}/{method}/tol{tolerance}.nc",
    log:
        "<logs>/{scene}/{sampling}/{method}/tol{tolerance}.log",
    params:
        physics=physics,
        sampling=sampling_settings,
        code=code("lifted_tolerance.py"),
    message:
        "{wildcards.scene}: lifted reduced model within {wildcards.tolerance}, snapshots {wildcards.sampling}"
    script:
        "../scripts/lifted_tolerance.py"


use rule reference as acceleration with:
    input:
        known_study,
        modes="<results>/{scene}/{sampling}/pod.nc",
        sph="<results>/{scene}/sph.nc",
    output:
        "<results>/{scene}/{sampling}/acceleration.nc",
    log:
        "<logs>/{scene}/{sampling}/acceleration.log",
    params:
        **computed(
            "reduced.rom.accelerate",
            of_sampling=True,
            n_freeze=lambda wildcards: study_settings(wildcards)["n_freeze"],
            mode_counts=lambda wildcards: study_settings(wildcards)["mode_counts"],
        ),
    message:
        "{wildcards.scene}: errors of the accelerated reduced models, snapshots {wildcards.sampling}"
