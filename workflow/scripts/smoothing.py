"""Compare smoothing lengths: consistency, stability and errors of full SPH."""

from sphpod.numerics import error
from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import smoothing

if __name__ == "__main__":
    given = job.start(snakemake)
    reference = dataset.read(snakemake.input.reference, *error.FIELDS)
    settings = dataset.settings(snakemake.input.reference)
    scene = Scene.from_settings(settings["scene"], settings)
    ratios = list(snakemake.params.smoothing_ratios)
    dataset.write(
        snakemake.output[0],
        smoothing.study(scene, ratios, reference),
        title=f"Smoothing lengths compared for {scene.name}",
        settings=settings | {"smoothing_ratios": ratios},
        code=snakemake.params.code,
        job=given,
    )
