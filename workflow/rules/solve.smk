"""Scenes are solved: full SPH in density and in strain, the references, and how far they are apart."""


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
        **computed(lambda wildcards: REFERENCES[wildcards.kind]),
    message:
        "{wildcards.scene}: reference solution, {wildcards.kind}"
    script:
        "../scripts/dataset.py"


use rule reference as lifted_full with:
    input:
        known_scene,
    output:
        "<results>/{scene}/lifted_full.nc",
    log:
        "<logs>/{scene}/lifted_full.log",
    params:
        **computed("full.lifted.solve", integrator="exact"),
    message:
        "{wildcards.scene}: lifted full model, exact in time"


use rule reference as errors with:
    input:
        known_scene,
        sph="<results>/{scene}/sph.nc",
        references=lambda wildcards: references(wildcards.scene),
    output:
        "<results>/{scene}/errors.nc",
    log:
        "<logs>/{scene}/errors.log",
    params:
        **computed(
            "numerics.error.table",
            kinds=lambda wildcards: SCENES[wildcards.scene]["references"],
        ),
    message:
        "{wildcards.scene}: errors of full SPH and of the references"
