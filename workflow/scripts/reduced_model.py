"""Run a reduced model for one or more mode counts, and compare it with SPH and the reference."""

from sphpod.numerics import error
from sphpod.pipeline import dataset, job
from sphpod.reduced import rom
from sphpod.scene.scene import Scene

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.pod)
    scene = Scene.from_settings(settings["scene"], settings)
    method, counts = snakemake.wildcards.method, list(snakemake.params.mode_counts)
    pod = dataset.read(snakemake.input.pod)
    sph, reference = (
        error.project_solution(dataset.read_samples(path, *error.FIELDS), pod, max(counts))
        for path in (snakemake.input.sph, snakemake.input.reference)
    )
    dataset.write(
        snakemake.output[0],
        rom.sweep(scene, method, counts, pod, sph, reference),
        title=f"Reduced model of {scene.name}, {method}",
        settings=settings | {"method": method, "mode_counts": counts},
        code=snakemake.params.code,
        job=given,
    )
