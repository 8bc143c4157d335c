"""Find the energy-orthonormal modes of velocity and strain snapshots."""

from sphpod.pipeline import dataset, job
from sphpod.reduced import lifted_rom
from sphpod.scene.scene import Scene

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.snapshots)
    scene = Scene.from_settings(settings["scene"], settings)
    dataset.write(
        snakemake.output[0],
        lifted_rom.decompose(scene, dataset.read(snakemake.input.snapshots)),
        title=f"Energy modes of the snapshots {settings['sampling']['name']} of {scene.name}",
        settings=settings,
        code=snakemake.params.code,
        job=given,
    )
