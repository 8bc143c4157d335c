"""Run a lifted reduced model for one or more mode counts, and tell its errors and their bound."""

from sphpod.numerics import error
from sphpod.pipeline import dataset, job
from sphpod.reduced import certificate, lifted_rom
from sphpod.scene.scene import Scene

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.pod)
    scene = Scene.from_settings(settings["scene"], settings)
    method, counts = snakemake.wildcards.method, list(snakemake.params.mode_counts)
    modes = dataset.read(snakemake.input.pod)
    reference = dataset.read_samples(snakemake.input.reference, *error.FIELDS)
    if method == "lifted_euler":
        full = dataset.read_samples(snakemake.input.full, *error.FIELDS)
        arrays = lifted_rom.repeat_sph(scene, counts, modes, full, reference)
    else:
        full = dataset.read(snakemake.input.full, "velocity", "strain")
        arrays = certificate.certify(scene, counts, modes, full, reference)
    dataset.write(
        snakemake.output[0],
        arrays,
        title=f"Reduced model of {scene.name}, {method}",
        settings=settings | {"method": method, "mode_counts": counts},
        code=snakemake.params.code,
        job=given,
    )
