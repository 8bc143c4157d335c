"""Run the original and the lifted model of the same snapshots for long."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import operators

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.pod)
    scene = Scene.from_settings(settings["scene"], settings)
    modes, energy_modes = map(dataset.read, (snakemake.input.pod, snakemake.input.lifted_pod))
    count = int(snakemake.wildcards.modes)
    horizon = snakemake.params.horizon_factor * scene.duration
    dataset.write(
        snakemake.output[0],
        operators.long_run(scene, count, modes, energy_modes, horizon),
        title=f"Models of {scene.name} over {horizon:g} s",
        settings=settings | {"mode_counts": [count], "horizon": horizon},
        code=snakemake.params.code,
        job=given,
    )
