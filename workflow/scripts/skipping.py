"""Time models with and without what a scene does not need."""

from sphpod import dataset, log, skipping, timing
from sphpod.scene import Scene

if __name__ == "__main__":
    log.start(snakemake.log[0])
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
    )
