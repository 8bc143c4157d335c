"""Tell the largest real parts of the spectra of operators on random bases."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import operators

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    count = snakemake.params.bases
    dataset.write(
        snakemake.output[0],
        operators.of_random_bases(scene, count, snakemake.params.seed),
        title=f"Spectra of operators of {name} on random bases",
        settings={"scene": name, **physics, "random_bases": count},
        code=snakemake.params.code,
        job=given,
    )
