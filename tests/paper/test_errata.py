"""The errata in a table."""

import re
from pathlib import Path

import yaml

from sphpod.paper import errata

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/reproducing-the-paper.md").read_text(encoding="utf-8")


def test_all_errata_of_the_page_are_rows():
    found = errata.rows(PAGE)
    assert [row["erratum"] for row in found] == [str(n + 1) for n in range(len(found))]
    assert len(found) >= 25
    for row in found:
        assert row["statement"]
        assert len(row["finding"]) > 20
        assert not re.search(r"[`\n]|\]\(", row["statement"] + row["finding"])


def test_claims_name_errata_that_there_are():
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))
    named = {claim["erratum"] for claim in config["claims"] if "erratum" in claim}
    assert named <= {int(row["erratum"]) for row in errata.rows(PAGE)}
