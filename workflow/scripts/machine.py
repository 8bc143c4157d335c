"""Compare what one thread and core compute with what more of them do."""

from sphpod import dataset, log, machine
from sphpod.scene import Scene

if __name__ == "__main__":
    log.start(snakemake.log[0])
    settings = dataset.settings(snakemake.input.snapshots)
    scene = Scene.from_settings(settings["scene"], settings)
    dataset.write(
        snakemake.output[0],
        machine.compare(scene, dataset.read(snakemake.input.snapshots)),
        title=f"Results of {scene.name} on different threads and cores",
        settings=settings,
        code=snakemake.params.code,
    )
