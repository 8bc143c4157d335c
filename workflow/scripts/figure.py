"""Draw a figure: its inputs and options are the arguments of a plotting function.

Where an input is a list of files, the argument holds each by its scene, or scene and sampling.
"""

from sphpod.figures import plotting
from sphpod.pipeline import dataset, job
from sphpod.studies import study


def arrays(files):
    if isinstance(files, str):
        return dataset.read_samples(files)
    return {dataset.place(path): dataset.read(path) for path in files}


if __name__ == "__main__":
    job.start(snakemake)
    inputs = {name: arrays(files) for name, files in snakemake.input.items()}
    figure = study.function(snakemake.params.draw)(**inputs, **snakemake.params.options)
    plotting.save(figure, snakemake.output.pdf, snakemake.output.png)
