"""Tell what was found of stability in a table, of which each kind has a module."""

import pandas as pd

from sphpod.pipeline import dataset, job
from sphpod.studies import (
    amplitude,
    detection,
    edge_scenes,
    growth,
    machine,
    operators,
    poor_snapshots,
    smoothing,
    time_steps,
)

ROWS = {
    "stability": time_steps.rows,
    "growth": growth.rows,
    "operators": operators.rows,
    "random_bases": lambda place, arrays: [operators.random_row(place, arrays)],
    "smoothing": smoothing.rows,
    "amplitude": amplitude.rows,
    "poor_snapshots": poor_snapshots.rows,
    "machine": machine.rows,
    "detection": detection.rows,
    "edge_scenes": edge_scenes.rows,
}


def place(path):
    scene, *sampling = dataset.place(path)
    return {"scene": scene, "sampling": "".join(sampling)}


if __name__ == "__main__":
    job.start(snakemake)
    table, paths = snakemake.params.table, snakemake.input
    if table == "smoothing_ranking":
        rows = smoothing.ranking(map(dataset.read, paths))
    else:
        rows = [row for path in paths for row in ROWS[table](place(path), dataset.read(path))]
    dataset.write_table(snakemake.output[0], pd.DataFrame(rows))
