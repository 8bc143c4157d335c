"""Tell from which mode count on each reduced model works, in one table."""

import pandas as pd

from sphpod.pipeline import dataset, job
from sphpod.reduced.rom import freeze_steps
from sphpod.studies import comparison

if __name__ == "__main__":
    job.start(snakemake)
    errors = {
        dataset.settings(path)["scene"]: dataset.read(path) for path in snakemake.input.errors
    }
    rows = []
    for path in snakemake.input.sweeps:
        settings = dataset.settings(path)
        scene, method = settings["scene"], settings["method"]
        sweep = dataset.read(path)
        rows.append(
            {
                "scene": scene,
                "sampling": settings["sampling"]["name"],
                "method": method,
                "n_freeze": 0 if method.startswith("lifted") else freeze_steps(method),
                "threshold": comparison.threshold(sweep, errors[scene]),
                "works_from": comparison.works_from(sweep, errors[scene]),
                "near_rounding": comparison.near_rounding(sweep),
            }
        )
    table = pd.DataFrame(rows).astype({"threshold": "Int64", "works_from": "Int64"})
    dataset.write_table(snakemake.output[0], table)
