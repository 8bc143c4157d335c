"""Put the rows of a study in a table: those of each dataset, or those of all datasets together."""

import inspect

import pandas as pd

from sphpod.pipeline import dataset, job
from sphpod.studies import study

if __name__ == "__main__":
    job.start(snakemake)
    rows_of, paths = study.function(snakemake.params.rows), snakemake.input
    if len(inspect.signature(rows_of).parameters) == 1:
        rows = rows_of([dataset.read(path) for path in paths])
    else:
        rows = []
        for path in paths:
            scene, *sampling = dataset.place(path)
            place = {"scene": scene, "sampling": "".join(sampling)}
            rows.extend(rows_of(place, dataset.read(path)))
    dataset.write_table(snakemake.output[0], pd.DataFrame(rows))
