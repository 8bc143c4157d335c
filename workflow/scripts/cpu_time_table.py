"""Tell CPU times and the savings against both full-SPH baselines in one table."""

import numpy as np
import pandas as pd

from sphpod import dataset, log

BASELINES = ("sph_neighbour_lists", "sph_stencil")


def rows(path):
    settings, arrays = dataset.settings(path), dataset.read(path)
    lower, median, upper = np.quantile(arrays["cpu_seconds"], (0.25, 0.5, 0.75), axis=1)
    baselines = {name: median[list(arrays["contender"]).index(name)] for name in BASELINES}
    return pd.DataFrame(
        {
            "scene": settings["scene"],
            "sampling": settings["sampling"]["name"],
            "contender": arrays["contender"],
            "mode_count": arrays["contender_mode_count"],
            "n_freeze": arrays["n_freeze"],
            "cpu_seconds_median": median,
            "cpu_seconds_interquartile_range": upper - lower,
            "repeats": arrays["cpu_seconds"].shape[1],
        }
        | {f"saving_against_{name}": 1 - median / time for name, time in baselines.items()}
    )


if __name__ == "__main__":
    log.start(snakemake.log[0])
    columns = rows(snakemake.input[0]).columns if snakemake.input else []
    dataset.write_table(
        snakemake.output[0], pd.concat([rows(path) for path in snakemake.input], ignore_index=True)
    )
