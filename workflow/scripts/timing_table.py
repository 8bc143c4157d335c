"""Tell measured CPU times in a table of one kind."""

import pandas as pd

from sphpod.pipeline import dataset, job
from sphpod.studies import timing


def table(paths, describe):
    """One table of the datasets, each described by columns that are the same for all."""
    return pd.concat(
        pd.DataFrame(
            {"scene": (settings := dataset.settings(path))["scene"]}
            | describe(settings, dataset.read(path))
            | {"machine": settings["machine"]["processor"]}
        )
        for path in paths
    )


def acceleration(settings, measured):
    return {
        "sampling": settings["sampling"]["name"],
        "contender": measured["contender"],
        "mode_count": measured["contender_mode_count"],
        "n_freeze": measured["n_freeze"],
        **timing.savings(measured),
    }


def step_time(settings, measured):
    return {
        "particle_count": settings["particle_count"],
        "contender": measured["contender"],
        **timing.speedups(measured),
    }


def cpu_time(settings, measured):
    return {"sampling": settings["sampling"]["name"], **timing.benchmark_columns(measured)}


def skipping(settings, measured):
    return {"particle_count": settings["particle_count"], **timing.skipping_columns(measured)}


if __name__ == "__main__":
    job.start(snakemake)
    describe = globals()[snakemake.params.kind]
    dataset.write_table(snakemake.output[0], table(snakemake.input, describe))
