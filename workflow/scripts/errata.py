"""Put the errata of the paper in a table."""

from sphpod.paper import errata
from sphpod.pipeline import job

if __name__ == "__main__":
    job.start(snakemake)
    errata.write(snakemake.params.page, snakemake.output[0])
