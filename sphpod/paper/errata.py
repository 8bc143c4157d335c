"""The errata of the paper, as docs/reproducing-the-paper.md lists them, in rows of a table."""

import os
import re
from pathlib import Path

from sphpod.pipeline.dataset import whole

ERRATUM = re.compile(r"^(\d+)\. \*(.+?)\*(?: \((\w+)\))?\.?(.+?)(?=^\d+\. |\Z)", re.M | re.S)
"""Number, *place and statement*, claim, if there is one, and finding."""


def rows(page: str) -> list[dict[str, str]]:
    """The errata in the text of that page, without its marks.

    Returns
    -------
    list of dict
        Of each its number (``erratum``), its ``place`` in the paper, what is ``said`` there and
        what is ``right``, the ``evidence``, and the ``claim`` that is judged by it, if any.
    """
    section = page.split("\n## Errata\n", 1)[1]
    section = re.split(r"^#+ ", section, maxsplit=1, flags=re.M)[0]
    return [_row(*found) for found in ERRATUM.findall(section)]


def _row(number, statement, claim, finding):
    place, _, said = _plain(statement).partition(", ")
    right, _, evidence = _plain(finding).partition(": ")
    return {
        "erratum": number,
        "place": place,
        "said": said,
        "right": right,
        "evidence": evidence,
        "claim": claim,
    }


def _plain(text):
    text = re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", " ".join(text.split()))
    return text.replace("`", "").strip().rstrip(".")


def write(page: str | os.PathLike[str], path: str | os.PathLike[str]) -> None:
    """Write the table as comma-separated values, whole or not at all."""
    import pandas as pd

    table = pd.DataFrame(rows(Path(page).read_text(encoding="utf-8")))
    with whole(path) as partial:
        table.to_csv(partial, index=False, lineterminator="\n")
