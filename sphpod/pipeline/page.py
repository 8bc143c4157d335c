"""A table as a page of its own, read and sorted in a browser without a network."""

import csv
import html
import os
from pathlib import Path

from sphpod.pipeline.dataset import whole

STYLE = """
body { font: 14px/1.4 sans-serif; margin: 1em; color: #111; background: #fff; }
h1 { font-size: 1.2em; }
input { font: inherit; padding: 0.2em 0.4em; width: 20em; max-width: 90%; }
.wide { overflow-x: auto; margin-top: 0.8em; }
table { border-collapse: collapse; }
th, td { border-bottom: 1px solid #d9d9d9; padding: 0.25em 0.6em; text-align: left;
  vertical-align: top; white-space: nowrap; }
td.long { white-space: normal; min-width: 14em; max-width: 28em; }
th { cursor: pointer; background: #f2f2f2; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
tr.deviates { background: #fff3e6; }
"""

SCRIPT = """
const table = document.querySelector("table"), body = table.tBodies[0];
const text = (row, n) => row.cells[n].dataset.value ?? row.cells[n].textContent;
const heads = table.tHead.rows[0].querySelectorAll("th");
heads.forEach((head, n) => head.addEventListener("click", () => {
  const down = head.dataset.down = head.dataset.down === "1" ? "" : "1";
  const order = (a, b) => text(a, n).localeCompare(text(b, n), "en", { numeric: true });
  const number = (a, b) => parseFloat(text(a, n)) - parseFloat(text(b, n));
  const rows = [...body.rows];
  const all = rows.every((row) => text(row, n) === "" || !isNaN(Number(text(row, n))));
  rows.sort(all ? number : order);
  body.append(...(down ? rows : rows.reverse()));
}));
document.querySelector("input").addEventListener("input", (event) => {
  const asked = event.target.value.toLowerCase();
  for (const row of body.rows) row.hidden = !row.textContent.toLowerCase().includes(asked);
});
"""


SHORT = 24
"""Characters that a line of a cell may have before it is broken."""


def of_table(title: str, rows: list[dict[str, str]]) -> str:
    """An HTML page of the rows of a table, alike in their columns: sorted by a click on a column.

    Numbers have four digits, and all of theirs where they are sorted; rows with the verdict
    "deviates" are marked.
    """
    columns = list(rows[0]) if rows else []
    head = "".join(f"<th>{html.escape(name)}</th>" for name in columns)
    body = "".join(_row([row[name] or "" for name in columns]) for row in rows)
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width"><title>{html.escape(title)}</title>'
        f"<style>{STYLE}</style></head><body><h1>{html.escape(title)}</h1>"
        f'<input placeholder="rows that hold …" aria-label="rows that hold">'
        f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        f"</div><script>{SCRIPT}</script></body></html>\n"
    )


def _row(cells):
    marked = ' class="deviates"' if "deviates" in cells else ""
    return f"<tr{marked}>{''.join(map(_cell, cells))}</tr>"


def _cell(text):
    try:
        value = float(text)
    except ValueError:
        kind = ' class="long"' if len(text) > SHORT else ""
        return f"<td{kind}>{html.escape(text)}</td>"
    return f'<td class="number" data-value="{html.escape(text)}">{value:.4g}</td>'


def write(table: str | os.PathLike[str], path: str | os.PathLike[str]) -> None:
    """Write the page of a table of comma-separated values, whole or not at all."""
    with open(table, encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    with whole(path) as partial:
        title = Path(table).stem.replace("_", " ")
        partial.write_text(of_table(title, rows), encoding="utf-8")
