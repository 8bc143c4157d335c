"""Compare the reduced models of an acceleration study with full SPH."""

from sphpod.numerics import error
from sphpod.pipeline import dataset, job
from sphpod.reduced import rom
from sphpod.scene.scene import Scene

if __name__ == "__main__":
    given = job.start(snakemake)
    settings, study = dataset.settings(snakemake.input.pod), snakemake.params.study
    scene = Scene.from_settings(settings["scene"], settings)
    pod = dataset.read(snakemake.input.pod)
    fields = dataset.read_samples(snakemake.input.sph, *error.FIELDS)
    sph = error.project_solution(fields, pod, max(study["mode_counts"]))
    dataset.write(
        snakemake.output[0],
        rom.accelerate(scene, study["n_freeze"], study["mode_counts"], pod, sph),
        title=f"Errors of the accelerated models of {scene.name}",
        settings=settings | {"study": study},
        code=snakemake.params.code,
        job=given,
    )
