"""Map the growth of full models against damping and time step."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import stability_map

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    dataset.write(
        snakemake.output[0],
        stability_map.of_damping(scene),
        title=f"Stability of {name} against damping and time step",
        settings={"scene": name, **physics},
        code=snakemake.params.code,
        job=given,
    )
