"""The lifted models: SPH in velocity and strain, full and reduced, with certified errors."""


rule lifted_full:
    input:
        known_scene,
    output:
        "<results>/{scene}/lifted_full.nc",
    log:
        "<logs>/{scene}/lifted_full.log",
    params:
        physics=physics,
        code=code("lifted_full.py"),
    message:
        "{wildcards.scene}: lifted full model, exact in time"
    script:
        "../scripts/lifted_full.py"


rule lifted_pod:
    input:
        known_sampling,
        snapshots="<results>/{scene}/{sampling}/snapshots.nc",
    output:
        "<results>/{scene}/{sampling}/lifted_pod.nc",
    log:
        "<logs>/{scene}/{sampling}/lifted_pod.log",
    params:
        physics=physics,
        sampling=sampling_settings,
        code=code("lifted_pod.py"),
    message:
        "{wildcards.scene}: energy modes of the snapshots {wildcards.sampling}"
    script:
        "../scripts/lifted_pod.py"


rule lifted_model:
    input:
        known_reduced_model,
        pod="<results>/{scene}/{sampling}/lifted_pod.nc",
        full=lambda wildcards: (
            f"<results>/{wildcards.scene}/"
            + ("sph.nc" if wildcards.method == "lifted_euler" else "lifted_full.nc")
        ),
        reference=lambda wildcards: references(wildcards.scene)[0],
    output:
        "<results>/{scene}/{sampling}/{method}/k{modes}.nc",
    log:
        "<logs>/{scene}/{sampling}/{method}/k{modes}.log",
    wildcard_constraints:
        method="lifted_euler|lifted_exact",
    params:
        physics=physics,
        sampling=sampling_settings,
        mode_counts=lambda wildcards: parse_modes(wildcards.modes),
        code=code("lifted_model.py"),
    message:
        "{wildcards.scene}: {wildcards.method} reduced model with {wildcards.modes} modes of {wildcards.sampling}"
    script:
        "../scripts/lifted_model.py"


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


rule thresholds:
    input:
        sweeps=full_sweeps("original", "lifted_euler") + study_sweeps(),
        errors=[f"<results>/{scene}/errors.nc" for scene in sampled_scenes()],
    output:
        "<results>/thresholds.csv",
    log:
        "<logs>/thresholds.log",
    params:
        code=code("thresholds.py"),
    message:
        "Mode counts from which each reduced model works"
    script:
        "../scripts/thresholds.py"


rule certificates:
    input:
        full_sweeps("lifted_exact"),
    output:
        effectivity="<results>/effectivity.csv",
        certificates="<results>/certificates.csv",
    log:
        "<logs>/certificates.log",
    params:
        code=code("certificates.py"),
    message:
        "Error bounds beside errors, and what they certify"
    script:
        "../scripts/certificates.py"
