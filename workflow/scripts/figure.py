"""Draw a figure: its inputs and options are the arguments of the plotting function of its kind."""

from sphpod.figures import plotting
from sphpod.pipeline import dataset, job

if __name__ == "__main__":
    job.start(snakemake)
    draw = getattr(plotting, snakemake.params.kind)
    arrays = {name: dataset.read_samples(path) for name, path in snakemake.input.items()}
    figure = draw(**arrays, **snakemake.params.options)
    plotting.save(figure, snakemake.output.pdf, snakemake.output.png)
