"""Predict how much the energy grows over long times, and measure it."""

from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import growth

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    horizons = [n * scene.duration for n in snakemake.params.horizon_factors]
    energy_horizon = snakemake.params.energy_horizon_factor * scene.duration
    dataset.write(
        snakemake.output[0],
        growth.measure(scene, horizons, energy_horizon),
        title=f"Growth of the energy of {name}",
        settings={"scene": name, **physics, "horizons": horizons, "energy_horizon": energy_horizon},
        code=snakemake.params.code,
        job=given,
    )
