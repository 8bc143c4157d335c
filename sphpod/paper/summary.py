"""What came out, in a few sentences: the beginning of a report."""

import csv
from collections import Counter
from pathlib import Path

import numpy as np

GAIN = "speedup_against_fastest_full_model"


def opening(results: Path) -> str:
    """Sentences on the results that there are, of claims, errors and run time; plain text.

    Parameters
    ----------
    results : path
        Folder of the results.
    """
    claims = _rows(results / "claims.csv", "criterion", "relative_difference", "verdict")
    timed = _rows(results / "benchmark.csv", "scene", "modes", "error_velocity", GAIN, "machine")
    parts = [_of_claims(claims), _of_times(timed)]
    return " ".join(part for part in parts if part) or "No claims have been decided yet."


def _rows(path, *columns):
    """Rows of a table; none if there is no such table, as a report is made of what there is."""
    if not path.is_file():
        return []
    with open(path, encoding="utf-8", errors="replace", newline="") as file:
        rows = list(csv.DictReader(file))
    return [row for row in rows if all(row.get(column) is not None for column in columns)]


def _of_claims(rows):
    if not rows:
        return ""
    words = Counter(row["verdict"].partition(" with")[0] for row in rows)
    with_erratum = sum("erratum" in row["verdict"] for row in rows)
    printed = [row for row in rows if row["criterion"].startswith("relative L2 error")]
    parts = [
        f"Of {len(rows)} claims that are checked, {words['reproduced']} are reproduced, "
        f"{with_erratum} of these with an erratum; deviating: {words['deviates']}."
    ]
    if printed:
        worst = max(abs(float(row["relative_difference"])) for row in printed)
        parts.append(
            f"The {len(printed)} printed errors of full SPH differ by at most {worst:.1e} of their "
            f"values."
        )
    return " ".join(parts)


def _number(text):
    """A number of a table, NaN where it has none."""
    return float(text) if text else np.nan


def _of_times(rows):
    if not rows:
        return ""
    name = GAIN
    fastest: dict[str, dict[str, str]] = {}
    for row in rows:
        good = _number(row["error_velocity"]) < 0.1 and int(row["modes"]) > 0
        place = row["scene"]
        if good and _number(row[name]) > _number(fastest.get(place, {name: "-inf"})[name]):
            fastest[place] = row
    if not fastest:
        return ""
    gains = np.array([_number(row[name]) for row in fastest.values()])
    return (
        f"The fastest reduced models within a tenth of full SPH take 1/{gains.min():.3g} to "
        f"1/{gains.max():.3g} of the time of the fastest full model of the same accuracy, on "
        f"{rows[0]['machine']}."
    )
