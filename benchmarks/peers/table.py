"""The comparison as files: a table for programs, and one for reading."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sphpod.pipeline.dataset import whole

HEADER = """# Other tools on the same scene

Scene ten_harmonics: N = 400, T = 10 s, velocities at up to 10001 times; reduced models have 12
modes for each field. CPU time is the process's own, one thread, of all of T with its outputs and
without what precedes the time loop: median of {repeats} turns, with the interquartile range in
brackets. Reduced models end with their coordinates at these times; to make fields of them is a
matrix product more for all of them alike, {fields:.0f} ms. Offline is the way from snapshots to a
reduced model, without taking the snapshots.

Errors are relative L2 errors of velocity over T: against this project's full SPH (explicit Euler,
Δt = 5e-5 s), against SPH exact in time, and against the exact solution of the line. Full models
were compared with SPH before anything else; "agrees" is the difference found, for explicit Euler
from full SPH, for other integrators from SPH exact in time. {processor}.

"""

COLUMNS = {
    "Tool": lambda row: f"{row['tool']} {row['version'] or ''}".strip(),
    "Model": lambda row: row["model"] or "",
    "Integrator": lambda row: row["integrator"] or "",
    "Step [µs]": lambda row: _number(row["step_seconds"], 1e6),
    "CPU time of T [ms]": lambda row: _spread(
        _number(row["cpu_seconds"], 1e3), _number(row["cpu_seconds_interquartile_range"], 1e3)
    ),
    "Offline [ms]": lambda row: _number(row["offline_seconds"], 1e3),
    "Error, SPH": lambda row: _error(row["error_velocity_sph"]),
    "Error, SPH exact in time": lambda row: _error(row["error_velocity_exact_in_time"]),
    "Error, exact": lambda row: _error(row["error_velocity_exact"]),
    "Agrees": lambda row: _error(row["full_model_difference"]),
    "Note": lambda row: row["note"],
}

SURVEY_HEADER = """# pyMOR on the worked survey of parameters

The survey graded_bar of config/surveys.yaml, of the same training runs: N = 400, T = 10 s, 101
outputs. k is the number of modes of each field, of symplectic bases half that of the vectors. A
cell has the error and, in ms, the CPU time of a query from its parameters to all quantities. Errors
are the largest energy norm over time of the difference to the lifted full model at the same
parameters, exact in time, of the largest norm of that: {queries}.
CPU time is the process's own, one thread: median of {repeats} turns. Offline is the way from the
training runs to a reduced model, the runs not included, where modes were made for all k. Growth is
the largest real part of the reduced operator at 50 random parameters without damping, for any of
these k, above rounding where waves grow; empty where it is proved that none do, and at the nominal
parameters. {processor}.

"""


def write(
    stem: str, rows: Sequence[Mapping[str, Any]], field_seconds: float, remarks: Sequence[str]
) -> None:
    """Write ``stem``.csv and ``stem``.md.

    Parameters
    ----------
    stem : str
    rows : dicts by column
        As from `run.rows`.
    field_seconds : float
        Time [s] of making fields from coordinates.
    remarks : sentences
        They stand below the table that is for reading.
    """
    header = HEADER.format(
        repeats=rows[0]["repeats"], processor=rows[0]["machine"], fields=1e3 * field_seconds
    )
    _files(stem, rows, header, _table(COLUMNS, rows), remarks)


def write_survey(stem: str, rows: Sequence[Mapping[str, Any]], queries: str) -> None:
    """The same of reduced models of a survey, one a line, rows as from `survey.compare`."""
    keys = "tool", "version", "model", "integrator"
    models = dict.fromkeys(tuple(row[key] for key in keys) for row in rows)
    found = {
        model: {row["modes"]: row for row in rows if tuple(row[key] for key in keys) == model}
        for model in models
    }
    counts = sorted({row["modes"] for row in rows})

    def cell(row):
        if row is None:
            return ""
        return f"{row['error_largest']:.1e}, {_number(row['query_seconds'], 1e3)}"

    columns: dict[str, Any] = {
        "Tool": lambda model: f"{model[0]} {model[1]}",
        "Model": lambda model: model[2],
        "In time": lambda model: model[3],
        **{f"k = {k}": lambda model, k=k: cell(found[model].get(k)) for k in counts},
        "Offline [s]": lambda model: _number(
            max(row["offline_seconds"] for row in found[model].values()), 1
        ),
        "Growth [1/s]": lambda model: _error(
            max((row["growth_rate"] for row in found[model].values()), key=lambda rate: rate or 0)
        ),
    }
    header = SURVEY_HEADER.format(
        repeats=rows[0]["repeats"], processor=rows[0]["machine"], queries=queries
    )
    _files(stem, rows, header, _table(columns, models), ())


def _files(stem, rows, header, lines, remarks):
    with whole(f"{stem}.csv") as partial, open(partial, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0].keys(), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    lines = [*lines, "", *remarks] if remarks else lines
    with whole(f"{stem}.md") as partial:
        Path(partial).write_text(header + "\n".join(lines) + "\n", encoding="utf-8")


def _table(columns, rows):
    head = [_line(columns), _line("---" for _ in columns)]
    return head + [_line(cell(row) for cell in columns.values()) for row in rows]


def _line(cells):
    return f"| {' | '.join(cells)} |"


def _number(value, factor):
    return "" if value is None else f"{value * factor:.3g}"


def _spread(median, interquartile_range):
    return f"{median} ({interquartile_range})" if median else ""


def _error(value):
    return "" if value is None else f"{value:.2e}"
