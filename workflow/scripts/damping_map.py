"""Map the growth of full models against damping and time step."""

from sphpod import dataset, log, stability_map
from sphpod.scene import Scene

if __name__ == "__main__":
    log.start(snakemake.log[0])
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    dataset.write(
        snakemake.output[0],
        stability_map.of_damping(scene),
        title=f"Stability of {name} against damping and time step",
        settings={"scene": name, **physics},
        code=snakemake.params.code,
    )
