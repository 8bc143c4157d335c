"""Make models of snapshots that are poor in every way, and judge them by their bounds."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import poor_snapshots

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.snapshots)
    scene = Scene.from_settings(settings["scene"], settings)
    taken = dataset.read(snakemake.input.snapshots)
    full = dataset.read(snakemake.input.full, "velocity", "strain")
    levels = list(snakemake.params.noise_levels)
    count = max(snakemake.params.mode_counts)
    dataset.write(
        snakemake.output[0],
        poor_snapshots.study(scene, taken, full, levels, count, seed=0),
        title=f"Models of {scene.name} from poor snapshots",
        settings=settings | {"mode_counts": [count]},
        code=snakemake.params.code,
        job=given,
    )
