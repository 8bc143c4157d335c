"""Tell the largest real parts of the spectra of reduced operators."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import operators

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.pod)
    scene = Scene.from_settings(settings["scene"], settings)
    counts = list(snakemake.params.mode_counts)
    modes, energy_modes = (
        dataset.read(snakemake.input.pod),
        dataset.read(snakemake.input.lifted_pod),
    )
    taken = dataset.read(snakemake.input.snapshots, "density_snapshots")["density_snapshots"]
    dataset.write(
        snakemake.output[0],
        operators.of_samplings(scene, counts, modes, energy_modes, taken),
        title=f"Spectra of reduced operators of {scene.name}",
        settings=settings | {"mode_counts": counts},
        code=snakemake.params.code,
        job=given,
    )
