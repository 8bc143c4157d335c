"""Put the rows of a study in a table: those of each dataset, or those of all datasets together."""

import inspect

import pandas as pd

from sphpod.pipeline import dataset, job
from sphpod.studies import study


def asked(rows_of):
    """Number of arguments that a function has no default for."""
    parameters = inspect.signature(rows_of).parameters.values()
    return sum(parameter.default is parameter.empty for parameter in parameters)


def rows_of_each(rows_of, paths):
    """Rows of each dataset, given its place, its arrays and, where asked for, its settings."""
    for path in paths:
        scene, *sampling = dataset.place(path)
        place = {"scene": scene, "sampling": "".join(sampling)}
        given = place, dataset.read(path), dataset.settings(path)
        rows = rows_of(*given[: asked(rows_of)])
        # Objects, as whole numbers stay so beside rows that have none.
        yield pd.DataFrame(rows if isinstance(rows, dict) else list(rows), dtype=object)


if __name__ == "__main__":
    job.start(snakemake)
    rows_of, paths = study.function(snakemake.params.rows), snakemake.input
    if asked(rows_of) == 1:
        table = pd.DataFrame(rows_of([dataset.read(path) for path in paths]), dtype=object)
    else:
        table = pd.concat(rows_of_each(rows_of, paths))
    dataset.write_table(snakemake.output[0], table)
