"""What a job of the workflow was given: its rule, inputs and parameters, kept with its results.

Snakemake makes a result anew once its parameters or the set of its inputs have changed, but what
they were it keeps in a folder of its own, ``.snakemake``. A dataset holds the same at its end, and
the log of any job in a line; so results that have lost that folder are judged alike. Paths are
given relative to the folder that result and log have in common, so that results are the same
wherever they are made.
"""

import atexit
import hashlib
import json
import logging
import os
import resource
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from sphpod.pipeline import dataset, log

CHECKSUM_LIMIT = 1_000_000
"""Inputs that are larger have no checksum: bytes, the value that Snakemake takes by default."""

_LINE = f"INFO {__name__}: "


def start(snakemake: Any) -> dict[str, Any]:
    """Begin the log of a job, which ends with what it was given, and return that: JSON types.

    The log of a job that fails or is killed keeps what the last one was given that succeeded, so
    that what has been made of its results is still known to be out of date.

    Parameters
    ----------
    snakemake
        The object of that name in the scripts of Snakemake.

    Raises
    ------
    ValueError
        For an input that is not what its rule wrote.
    """
    path = snakemake.log[0]
    before = given_in_log(path) if os.path.exists(path) else None
    log.start(path)
    if before:
        _record(before)
    root = os.path.commonpath([*snakemake.output, *snakemake.log])

    def relative(paths: Iterable[str]) -> list[str]:
        return sorted(os.path.relpath(path, root) for path in paths)

    inputs = sorted(set(snakemake.input))
    for path in inputs:
        if path.endswith(".nc"):
            given(path)
    record = {
        "rule": snakemake.rule,
        "input": relative(snakemake.input),
        "output": relative(snakemake.output),
        "log": relative(snakemake.log),
        "params": sorted(map(repr, snakemake.params)),
        "checksums": {
            os.path.relpath(path, root): hashlib.sha256(Path(path).read_bytes()).hexdigest()
            for path in inputs
            if os.path.getsize(path) <= CHECKSUM_LIMIT
        },
    }
    atexit.register(_record_success, record)
    atexit.register(_report_use)
    return record


def _record(record: dict[str, Any]) -> None:
    logging.getLogger(__name__).info(json.dumps(record))


def _record_success(record: dict[str, Any]) -> None:
    # Python keeps here the exception that nobody caught.
    if not hasattr(sys, "last_value"):
        _record(record)


def _report_use() -> None:
    """What the job took, by which resources of a cluster can be asked for."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    unit = 1 if sys.platform == "darwin" else 1024
    logging.getLogger(__name__).info(
        "took %.1f s of CPU time and %d MB of memory",
        used.ru_utime + used.ru_stime,
        used.ru_maxrss * unit / 1e6,
    )


def given(path: str | os.PathLike[str]) -> dict[str, Any] | None:
    """What the job that wrote a dataset was given; None where the file does not hold it.

    Raises
    ------
    ValueError
        For a file that is no dataset, or one that was written to another place.
    """
    record = dataset.job(path)
    if record and not _is_one_of(path, record["output"]):
        raise ValueError(dataset.foreign(path))
    return record


def given_in_log(path: str | os.PathLike[str]) -> dict[str, Any] | None:
    """The same of the last job that wrote a log and succeeded.

    None where the log does not hold it, or is another job's.
    """
    with open(path, encoding="utf-8", errors="replace") as file:
        lines = [line.removeprefix(_LINE) for line in file if line.startswith(_LINE + "{")]
    record = json.loads(lines[-1]) if lines else None
    return record if record and _is_one_of(path, record["log"]) else None


def _is_one_of(path: str | os.PathLike[str], relative: Iterable[str]) -> bool:
    parts = Path(os.path.abspath(path)).parts
    return any(parts[-len(tail) :] == tail for tail in (Path(own).parts for own in relative))
