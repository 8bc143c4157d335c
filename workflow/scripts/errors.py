"""Compare full SPH with all references, and the other references with the exact solution."""

import numpy as np

from sphpod.numerics import error
from sphpod.pipeline import dataset, job

if __name__ == "__main__":
    given = job.start(snakemake)
    kinds = list(snakemake.params.kinds)
    files = zip(["sph", *kinds], [snakemake.input.sph, *snakemake.input.references], strict=True)
    paths = dict(files)
    arrays = {"solution": np.array(list(paths)), "reference": np.array(kinds)}
    for field in error.FIELDS:
        solutions = {name: dataset.read_samples(path, field)[field] for name, path in paths.items()}
        arrays[f"{field}_error"] = error.compare(solutions, kinds)
    dataset.write(
        snakemake.output[0],
        arrays,
        title=f"Errors of full SPH and of the references of {snakemake.wildcards.scene}",
        settings=dataset.settings(snakemake.input.sph) | {"references": kinds},
        code=snakemake.params.code,
        job=given,
    )
