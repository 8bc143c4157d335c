"""Tell what was found of stability in a table, of which each kind has a module."""

import pandas as pd

from sphpod import (
    amplitude,
    dataset,
    detection,
    edge_scenes,
    growth,
    limits,
    log,
    machine,
    poor_snapshots,
    reduced_operators,
    smoothing,
)

ROWS = {
    "stability": limits.rows,
    "growth": growth.rows,
    "operators": reduced_operators.rows,
    "smoothing": smoothing.rows,
    "amplitude": amplitude.rows,
    "poor_snapshots": poor_snapshots.rows,
    "machine": machine.rows,
    "detection": detection.rows,
    "edge_scenes": edge_scenes.rows,
}

if __name__ == "__main__":
    log.start(snakemake.log[0])
    rows = []
    for path in snakemake.input:
        settings = dataset.settings(path)
        sampling = settings.get("sampling", {}).get("name", "")
        place = {"scene": settings["scene"], "sampling": sampling}
        rows += ROWS[snakemake.params.table](place, dataset.read(path))
    dataset.write_table(snakemake.output[0], pd.DataFrame(rows))
