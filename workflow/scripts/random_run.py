"""Run a reduced model of random modes that grows, and the lifted one of the same modes."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import operators

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    dataset.write(
        snakemake.output[0],
        operators.example(scene, seed=0),
        title=f"A model of {name} on random modes that grows",
        settings={"scene": name, **physics},
        code=snakemake.params.code,
        job=given,
    )
