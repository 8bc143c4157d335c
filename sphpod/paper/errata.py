"""The errata of the paper, as docs/reproducing-the-paper.md lists them, in rows of a table."""

import os
import re
from pathlib import Path

from sphpod.pipeline.dataset import whole


def rows(page: str) -> list[dict[str, str]]:
    """Number, statement and finding of each erratum in the text of that page, without its marks."""
    section = page.split("\n## Errata\n", 1)[1]
    section = re.split(r"^#+ ", section, maxsplit=1, flags=re.M)[0]
    found = re.findall(r"^(\d+)\. \*(.+?)\*(.+?)(?=^\d+\. |\Z)", section, re.M | re.S)
    return [
        {"erratum": number, "statement": _plain(said), "finding": _plain(finding).lstrip(". ")}
        for number, said, finding in found
    ]


def _plain(text):
    text = re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", " ".join(text.split()))
    return text.replace("`", "").rstrip(".")


def write(page: str | os.PathLike[str], path: str | os.PathLike[str]) -> None:
    """Write the table as comma-separated values, whole or not at all."""
    import pandas as pd

    table = pd.DataFrame(rows(Path(page).read_text(encoding="utf-8")))
    with whole(path) as partial:
        table.to_csv(partial, index=False, lineterminator="\n")
