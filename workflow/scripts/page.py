"""Make a page of a table, to be read and sorted in a browser."""

from sphpod.pipeline import job, page

if __name__ == "__main__":
    job.start(snakemake)
    page.write(snakemake.input[0], snakemake.output[0])
