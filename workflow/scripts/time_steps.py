"""Foretell the largest stable time steps of full models, and measure them."""

from sphpod import dataset, limits, log
from sphpod.scene import Scene

if __name__ == "__main__":
    log.start(snakemake.log[0])
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    dataset.write(
        snakemake.output[0],
        limits.full(scene),
        title=f"Stable time steps of full models of {name}",
        settings={"scene": name, **physics},
        code=snakemake.params.code,
    )
