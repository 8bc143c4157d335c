"""Map the growth of reduced models against mode count and time step."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import stability_map

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
        stability_map.of_modes(scene, counts, modes, energy_modes),
        title=f"Stability of {scene.name} against modes and time step",
        settings=settings | {"mode_counts": counts},
        code=snakemake.params.code,
        job=given,
    )
