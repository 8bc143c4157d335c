"""Tell measured CPU times in two tables: savings of the studies, speed of a step of full SPH."""

import pandas as pd

from sphpod import dataset, log, timing


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


def study(settings, measured):
    return {
        "sampling": settings["sampling"]["name"],
        "contender": measured["contender"],
        "mode_count": measured["contender_mode_count"],
        "n_freeze": measured["n_freeze"],
        **timing.savings(measured),
    }


def step(settings, measured):
    return {
        "particle_count": settings["particle_count"],
        "contender": measured["contender"],
        **timing.speedups(measured),
    }


if __name__ == "__main__":
    log.start(snakemake.log[0])
    describe = {"cpu_time": study, "step_time": step}[snakemake.params.kind]
    dataset.write_table(snakemake.output[0], table(snakemake.input, describe))
