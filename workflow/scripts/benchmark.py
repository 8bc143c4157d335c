"""Time full and reduced models of a study by every method, and tell their errors."""

from sphpod.numerics import error
from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import benchmark, timing

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.snapshots)
    scene = Scene.from_settings(settings["scene"], settings)
    study, repeats = snakemake.params.study, snakemake.params.repeats
    dataset.write(
        snakemake.output[0],
        benchmark.compare(
            scene,
            settings["sampling"],
            study,
            dataset.read(snakemake.input.snapshots),
            dataset.read_samples(snakemake.input.sph, *error.FIELDS),
            repeats,
        ),
        title=f"CPU times and errors of the models of {scene.name}",
        settings=settings | {"study": study, "repeats": repeats, "machine": timing.machine()},
        code=snakemake.params.code,
        job=given,
    )
