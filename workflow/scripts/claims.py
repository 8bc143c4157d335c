"""Decide on the claims, in a table of values and in one for reading."""

from functools import cache
from pathlib import Path

import pandas as pd

from sphpod.paper import claims
from sphpod.pipeline import dataset, job

if __name__ == "__main__":
    job.start(snakemake)
    results = Path(snakemake.output.table).parent
    rows = claims.table(snakemake.params.claims, cache(lambda path: dataset.read(results / path)))
    dataset.write_table(snakemake.output.table, pd.DataFrame(rows, columns=claims.COLUMNS))
    with dataset.whole(snakemake.output.text) as partial:
        partial.write_text(claims.markdown(rows), encoding="utf-8")
