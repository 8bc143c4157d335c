"""Draw a figure of stability: its inputs are the arguments of its kind's plotting function."""

from sphpod import dataset, job, plotting, stability_plots

if __name__ == "__main__":
    job.start(snakemake)
    draw = getattr(stability_plots, snakemake.params.kind)
    figure = draw(**{name: dataset.read(path) for name, path in snakemake.input.items()})
    plotting.save(figure, snakemake.output.pdf, snakemake.output.png)
