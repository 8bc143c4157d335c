"""Put what a survey found in a table."""

import pandas as pd

from sphpod.pipeline import dataset, job
from sphpod.studies import study

if __name__ == "__main__":
    job.start(snakemake)
    rows = study.function(f"surveys.tables.{snakemake.params.rows}")
    found = dataset.read(snakemake.input[0])
    dataset.write_table(snakemake.output[0], pd.DataFrame(rows(found)))
