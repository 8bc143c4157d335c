"""Time one step of full SPH, compiled and as a loop over sparse products."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import timing

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics, repeats = (
        snakemake.wildcards.scene,
        snakemake.params.physics,
        snakemake.params.repeats,
    )
    dataset.write(
        snakemake.output[0],
        timing.compare_steps(Scene.from_settings(name, physics), repeats),
        title=f"CPU time of a step of full SPH of {name}",
        settings={"scene": name, **physics, "repeats": repeats, "machine": timing.machine()},
        code=snakemake.params.code,
        job=given,
    )
