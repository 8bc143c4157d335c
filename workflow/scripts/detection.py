"""Time full models that watch for a breakdown, and that do not."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import detection, timing

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    repeats = snakemake.params.repeats
    dataset.write(
        snakemake.output[0],
        detection.measure(scene, repeats),
        title=f"Cost of watching {name} for a breakdown",
        settings={"scene": name, **physics, "repeats": repeats, "machine": timing.machine()},
        code=snakemake.params.code,
        job=given,
    )
