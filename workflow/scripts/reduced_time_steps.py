"""Predict the largest stable time steps of reduced models, and measure them."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import time_steps

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.pod)
    scene = Scene.from_settings(settings["scene"], settings)
    counts = list(snakemake.params.mode_counts)
    modes, energy_modes = (
        dataset.read(snakemake.input.pod),
        dataset.read(snakemake.input.lifted_pod),
    )
    dataset.write(
        snakemake.output[0],
        time_steps.reduced(scene, counts, modes, energy_modes),
        title=f"Stable time steps of reduced models of {scene.name}",
        settings=settings | {"mode_counts": counts},
        code=snakemake.params.code,
        job=given,
    )
