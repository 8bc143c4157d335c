"""Compare full SPH with all references, and the other references with the exact solution."""

import numpy as np

from sphpod import dataset, error, log

FIELDS = ("velocity", "density")

if __name__ == "__main__":
    log.start(snakemake.log[0])
    kinds = list(snakemake.params.kinds)
    solutions = ["sph", *kinds]
    paths = dict(zip(solutions, [snakemake.input.sph, *snakemake.input.references], strict=True))
    pairs = [("sph", kind) for kind in kinds]
    if "exact" in kinds:
        pairs += [(kind, "exact") for kind in kinds if kind != "exact"]
    errors = {f"{field}_error": np.full((len(solutions), len(kinds)), np.nan) for field in FIELDS}
    for field in FIELDS:
        fields = {name: dataset.read_samples(path, field)[field] for name, path in paths.items()}
        for solution, reference in pairs:
            place = solutions.index(solution), kinds.index(reference)
            errors[f"{field}_error"][place] = error.relative_error(
                fields[solution], fields[reference]
            )
    dataset.write(
        snakemake.output[0],
        {"solution": np.array(solutions), "reference": np.array(kinds), **errors},
        title=f"Errors of full SPH and of the references of {snakemake.wildcards.scene}",
        settings=dataset.settings(snakemake.input.sph) | {"references": kinds},
        code=snakemake.params.code,
    )
