"""Time full SPH and the reduced models of an acceleration study."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import timing

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.pod)
    scene = Scene.from_settings(settings["scene"], settings)
    study, repeats = snakemake.params.study, snakemake.params.repeats
    pod = dataset.read(snakemake.input.pod)
    dataset.write(
        snakemake.output[0],
        timing.compare(scene, pod, study["mode_counts"], study["n_freeze"], repeats),
        title=f"CPU times of the models of {scene.name}",
        settings=settings | {"study": study, "repeats": repeats, "machine": timing.machine()},
        code=snakemake.params.code,
        job=given,
    )
