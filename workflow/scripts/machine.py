"""Compare what one thread and core compute with what more of them do."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import machine

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.snapshots)
    scene = Scene.from_settings(settings["scene"], settings)
    dataset.write(
        snakemake.output[0],
        machine.compare(scene, dataset.read(snakemake.input.snapshots)),
        title=f"Results of {scene.name} on different threads and cores",
        settings=settings,
        code=snakemake.params.code,
        job=given,
    )
