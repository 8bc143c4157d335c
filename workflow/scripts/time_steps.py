"""Predict the largest stable time steps of full models, and measure them."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import time_steps

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    dataset.write(
        snakemake.output[0],
        time_steps.full(scene),
        title=f"Stable time steps of full models of {name}",
        settings={"scene": name, **physics},
        code=snakemake.params.code,
        job=given,
    )
