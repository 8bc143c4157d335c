"""Scenes are solved: full SPH, the references, and how far they are apart."""


rule sph:
    input:
        known_scene,
    output:
        "<results>/{scene}/sph.nc",
    log:
        "<logs>/{scene}/sph.log",
    params:
        physics=physics,
        snapshot_steps=snapshot_steps,
        code=code("sph.py"),
    message:
        "{wildcards.scene}: full SPH"
    script:
        "../scripts/sph.py"


rule reference:
    input:
        known_reference,
    output:
        "<results>/{scene}/reference_{kind}.nc",
    log:
        "<logs>/{scene}/reference_{kind}.log",
    params:
        physics=physics,
        code=code("reference.py"),
    message:
        "{wildcards.scene}: reference solution, {wildcards.kind}"
    script:
        "../scripts/reference.py"


rule errors:
    input:
        known_scene,
        sph="<results>/{scene}/sph.nc",
        references=lambda wildcards: references(wildcards.scene),
    output:
        "<results>/{scene}/errors.nc",
    log:
        "<logs>/{scene}/errors.log",
    params:
        physics=physics,
        kinds=lambda wildcards: SCENES[wildcards.scene]["references"],
        code=code("errors.py"),
    message:
        "{wildcards.scene}: errors of full SPH and of the references"
    script:
        "../scripts/errors.py"
