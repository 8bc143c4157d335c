"""Measure how the time and memory of a step grow with particles and with modes."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import scaling, timing

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics, benchmark = (
        snakemake.wildcards.scene,
        snakemake.params.physics,
        snakemake.params.benchmark,
    )
    scene = Scene.from_settings(name, physics)
    counts = benchmark["particle_counts"], benchmark["mode_counts"]
    dataset.write(
        snakemake.output[0],
        scaling.measure(scene, *counts, benchmark["repeats"]),
        title=f"Time and memory of a step of {name}",
        settings={"scene": name, **physics, **benchmark, "machine": timing.machine()},
        code=snakemake.params.code,
        job=given,
    )
