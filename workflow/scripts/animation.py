"""Animate full SPH and reduced models beside it."""

from sphpod.figures import animation
from sphpod.pipeline import dataset, job

if __name__ == "__main__":
    job.start(snakemake)
    solutions = {name: dataset.read_samples(path) for name, path in snakemake.input.items()}
    animation.write(snakemake.output[0], **solutions, seconds=snakemake.params.seconds)
