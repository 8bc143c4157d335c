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
        assert re.match(r"Sections? [\dC]|Appendix [A-C]|Caption|Conclusions", row["place"]), row
        assert row["said"]
        assert row["right"]
        assert len(row["evidence"]) > 20
        assert not re.search(r"[`*\n]|\]\(", "".join(row.values()))
    assert found[0] | {"evidence": ""} == {
        "erratum": "1",
        "place": "Section 3.1",
        "said": "error formula",
        "right": "It lacks the square root",
        "evidence": "",
        "claim": "",
    }


def test_errata_of_claims_name_them():
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))
    named = {row["claim"] for row in errata.rows(PAGE)} - {""}
    assert named <= {claim["id"] for claim in config["claims"]}
    assert {"M01", "M11", "M26"} <= named


def test_claims_name_errata_that_there_are():
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))
    named = {claim["erratum"] for claim in config["claims"] if "erratum" in claim}
    assert named <= {int(row["erratum"]) for row in errata.rows(PAGE)}
