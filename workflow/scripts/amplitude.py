"""Scale the initial velocity up until the scene folds, with all models."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import amplitude

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    sampling, count = snakemake.params.sampling, max(snakemake.params.mode_counts)
    chosen = {"name": snakemake.wildcards.sampling, **sampling}
    dataset.write(
        snakemake.output[0],
        amplitude.study(scene, sampling, count, snakemake.params.amplitude_count),
        title=f"Models of {name} against its amplitude",
        settings={"scene": name, **physics, "sampling": chosen, "mode_counts": [count]},
        code=snakemake.params.code,
        job=given,
    )
