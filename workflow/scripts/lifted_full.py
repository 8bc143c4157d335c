"""Solve the lifted full model, exactly in time, at the times of the error integral."""

from sphpod.full import lifted
from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    dataset.write(
        snakemake.output[0],
        lifted.solve(Scene.from_settings(name, physics), "exact"),
        title=f"Lifted full model of {name}, exact in time",
        settings={"scene": name, **physics},
        code=snakemake.params.code,
        job=given,
    )
