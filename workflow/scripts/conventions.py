"""The paper's numbers without its unsaid conventions, and the errors of its references."""

from pathlib import Path

import pandas as pd

from sphpod.paper import conventions, paper
from sphpod.pipeline import dataset, job

if __name__ == "__main__":
    job.start(snakemake)
    results = Path(snakemake.output.conventions).parent

    def read(path, *names):
        return dataset.read_samples(results / path, *names)

    study = snakemake.params.study
    for output, rows in (
        (snakemake.output.conventions, conventions.table(study, read)),
        (snakemake.output.errors, paper.reference_errors(study, read)),
    ):
        dataset.write_table(output, pd.DataFrame(rows, dtype=object))
