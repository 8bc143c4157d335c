"""Call the function of a study with its scene, inputs and arguments, and write what it returns."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import study, timing

if __name__ == "__main__":
    given = job.start(snakemake)
    params, wildcards = snakemake.params, snakemake.wildcards
    scene = Scene.from_settings(wildcards.scene, params.physics)
    inputs = {name: dataset.read_samples(path) for name, path in snakemake.input.items()}
    arguments = dict(params.arguments)
    settings = {"scene": scene.name, **params.physics, **arguments}
    if params.sampling:
        settings["sampling"] = {"name": wildcards.sampling, **params.sampling}
    if params.alone:
        settings["machine"] = timing.machine()
    declared = study.declared(f"studies.{params.study}")
    message = declared.datasets[snakemake.rule].message
    dataset.write(
        snakemake.output[0],
        study.function(params.compute)(scene, **inputs, **arguments),
        title=message.format(**wildcards),
        settings=settings,
        code=params.code,
        job=given,
        variables=declared.variables,
    )
