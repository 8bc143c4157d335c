"""Solve a scene by finite differences or exactly, at the times of the error integral."""

from sphpod.pipeline import dataset, job
from sphpod.reference import exact, reference
from sphpod.scene.scene import Scene

SOLVERS = {
    "fd": reference.solve_paper,
    "centred": reference.solve_centred,
    "exact": exact.solve,
    "modified": exact.solve_modified,
}

if __name__ == "__main__":
    given = job.start(snakemake)
    name, kind = snakemake.wildcards.scene, snakemake.wildcards.kind
    physics = snakemake.params.physics
    dataset.write(
        snakemake.output[0],
        SOLVERS[kind](Scene.from_settings(name, physics)),
        title=f"Reference solution of {name}, {kind}",
        settings={"scene": name, **physics, "reference": kind},
        code=snakemake.params.code,
        job=given,
    )
