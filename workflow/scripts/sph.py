"""Solve full SPH; keep it at the times of the error integral and of all snapshots of the scene."""

import numpy as np

from sphpod import bar
from sphpod.full import sph
from sphpod.pipeline import dataset, job
from sphpod.scene import checks, resolution, waves
from sphpod.scene.scene import Scene

if __name__ == "__main__":
    given = job.start(snakemake)
    name, physics = snakemake.wildcards.scene, snakemake.params.physics
    scene = Scene.from_settings(name, physics)
    checks.check(scene)  # before the run of many they have been looked at in fewer places
    steps = np.union1d(scene.error_steps, snakemake.params.snapshot_steps).astype(np.int64)
    predicted = waves.predict(scene) | resolution.predict(scene)
    dataset.write(
        snakemake.output[0],
        {
            **bar.of_bar(scene, sph.solve(scene, steps)),
            "error_sample": np.isin(steps, scene.error_steps),
        },
        title=f"Full SPH of {name}",
        settings={"scene": name, **physics},
        code=snakemake.params.code,
        job=given,
        attributes=predicted,
    )
