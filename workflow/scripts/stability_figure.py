"""Draw a figure of stability: its inputs are the arguments of its kind's plotting function.

Where an input is a list of files, the argument holds each by its scene, or scene and sampling.
"""

from sphpod.figures import plotting, stability_plots
from sphpod.pipeline import dataset, job


def tables(files):
    if isinstance(files, str):
        return dataset.read(files)
    return {dataset.place(path): dataset.read(path) for path in files}


if __name__ == "__main__":
    job.start(snakemake)
    draw = getattr(stability_plots, snakemake.params.kind)
    figure = draw(**{name: tables(files) for name, files in snakemake.input.items()})
    plotting.save(figure, snakemake.output.pdf, snakemake.output.png)
