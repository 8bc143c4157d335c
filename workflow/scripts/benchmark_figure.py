"""Draw a figure of the benchmarks: its inputs are the arguments of its kind's plotting function."""

from sphpod.figures import benchmark_plots, plotting
from sphpod.pipeline import dataset, job

if __name__ == "__main__":
    job.start(snakemake)
    draw = getattr(benchmark_plots, snakemake.params.kind)
    arrays = {name: dataset.read_samples(path) for name, path in snakemake.input.items()}
    figure = draw(**arrays, **snakemake.params.options)
    plotting.save(figure, snakemake.output.pdf, snakemake.output.png)
