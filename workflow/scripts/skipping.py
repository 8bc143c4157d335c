"""Time models with and without what a scene does not need."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import skipping, timing

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics, repeats = (
        snakemake.wildcards.scene,
        snakemake.params.physics,
        snakemake.params.repeats,
    )
    dataset.write(
        snakemake.output[0],
        skipping.measure(Scene.from_settings(name, physics), repeats),
        title=f"CPU time that {name} saves by what it does not need",
        settings={"scene": name, **physics, "repeats": repeats, "machine": timing.machine()},
        code=snakemake.params.code,
        job=given,
    )
