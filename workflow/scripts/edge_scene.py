"""Check what must hold of a scene at the edge of what can be computed."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import edge_scenes

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    dataset.write(
        snakemake.output[0],
        edge_scenes.study(scene),
        title=f"Checks of {name}",
        settings={"scene": name, **physics},
        code=snakemake.params.code,
        job=given,
    )
