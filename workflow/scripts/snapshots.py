"""Take the snapshots of a sampling out of full SPH."""

from sphpod.pipeline import dataset, job
from sphpod.reduced import rounding, snapshots
from sphpod.scene.scene import Scene

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.sph)
    scene = Scene.from_settings(settings["scene"], settings)
    sampling = {"name": snakemake.wildcards.sampling, **snakemake.params.sampling}
    dataset.write(
        snakemake.output[0],
        snapshots.extract(scene, sampling, dataset.read(snakemake.input.sph))
        | rounding.twins(scene, sampling),
        title=f"Snapshots {sampling['name']} of full SPH of {scene.name}",
        settings=settings | {"sampling": sampling},
        code=snakemake.params.code,
        job=given,
    )
