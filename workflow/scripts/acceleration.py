"""Compare the reduced models of an acceleration study with full SPH."""

from sphpod import dataset, error, log, rom
from sphpod.scene import Scene

if __name__ == "__main__":
    log.start(snakemake.log[0])
    settings, study = dataset.settings(snakemake.input.pod), snakemake.params.study
    scene = Scene.from_settings(settings["scene"], settings)
    pod = dataset.read(snakemake.input.pod)
    sph = error.project_solution(dataset.read_samples(snakemake.input.sph, *error.FIELDS), pod)
    dataset.write(
        snakemake.output[0],
        rom.accelerate(scene, study["n_freeze"], study["mode_counts"], pod, sph),
        title=f"Errors of the accelerated models of {scene.name}",
        settings=settings | {"study": study},
        code=snakemake.params.code,
    )
