"""Run a reduced model for one or more mode counts, and compare it with SPH and the reference."""

from sphpod import dataset, error, log, rom
from sphpod.scene import Scene


def projections(path, pod):
    """Velocity and density of a solution, seen from the modes."""
    fields = dataset.read_samples(path, "velocity", "density")
    return {name: error.project(field, pod[f"{name}_modes"]) for name, field in fields.items()}


if __name__ == "__main__":
    log.start(snakemake.log[0])
    settings = dataset.settings(snakemake.input.pod)
    scene = Scene.from_settings(settings["scene"], settings)
    method, counts = snakemake.wildcards.method, list(snakemake.params.mode_counts)
    pod = dataset.read(snakemake.input.pod)
    arrays = rom.sweep(
        scene,
        method,
        counts,
        pod,
        sph=projections(snakemake.input.sph, pod),
        reference=projections(snakemake.input.reference, pod),
    )
    dataset.write(
        snakemake.output[0],
        arrays,
        title=f"Reduced model of {scene.name}, {method}",
        settings=settings | {"method": method, "mode_counts": counts},
        code=snakemake.params.code,
    )
