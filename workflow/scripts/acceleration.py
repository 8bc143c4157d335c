"""Compare the reduced models of an acceleration study with full SPH."""

import numpy as np

from sphpod import dataset, error, log, rom, timing
from sphpod.scene import Scene


def projections(path, pod):
    """Velocity and density of a solution, seen from the modes."""
    fields = dataset.read_samples(path, "velocity", "density")
    return {name: error.project(field, pod[f"{name}_modes"]) for name, field in fields.items()}


if __name__ == "__main__":
    log.start(snakemake.log[0])
    settings, study = dataset.settings(snakemake.input.pod), snakemake.params.study
    scene = Scene.from_settings(settings["scene"], settings)
    pod = dataset.read(snakemake.input.pod)
    sph = projections(snakemake.input.sph, pod)
    contenders = timing.acceleration_contenders(study["n_freeze"])
    sweeps = [
        rom.sweep(scene, method, study["mode_counts"], pod, sph=sph, reference=sph)
        for method in contenders
    ]
    arrays = {
        "contender": np.array(contenders),
        "n_freeze": np.array([rom.freeze_steps(method) for method in contenders]),
        "mode_count": np.array(study["mode_counts"]),
    } | {
        f"acceleration_{field}_error": np.array([sweep[f"{field}_error_sph"] for sweep in sweeps])
        for field in ("velocity", "density")
    }
    dataset.write(
        snakemake.output[0],
        arrays,
        title=f"Errors of the accelerated models of {scene.name}",
        settings=settings | {"study": study},
        code=snakemake.params.code,
    )
