"""Tell how sharp the error bounds are, and what they certify, in two tables."""

import pandas as pd

from sphpod.pipeline import dataset, job
from sphpod.studies import comparison

if __name__ == "__main__":
    job.start(snakemake)
    effectivities, certificates = [], []
    for path in snakemake.input:
        settings, sweep = dataset.settings(path), dataset.read(path)
        place = {"scene": settings["scene"], "sampling": settings["sampling"]["name"]}
        effectivities += comparison.effectivities(place, sweep)
        certificates += comparison.certificates(place, sweep)
    dataset.write_table(snakemake.output.effectivity, pd.DataFrame(effectivities))
    table = pd.DataFrame(certificates).astype({"modes": "Int64"})
    dataset.write_table(snakemake.output.certificates, table)
