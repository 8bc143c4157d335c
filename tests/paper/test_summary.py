"""What came out, in a few sentences."""

import csv

from sphpod.paper import summary


def write(path, rows):
    with open(path, "w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)


def test_an_opening_counts_the_verdicts_and_says_what_is_fastest(tmp_path):
    assert summary.opening(tmp_path) == "No claims have been decided yet."
    (tmp_path / "claims.csv").write_text("something else\n1\n", encoding="utf-8")
    assert summary.opening(tmp_path) == "No claims have been decided yet."
    text = "relative L2 error of full SPH in velocity"
    write(tmp_path / "claims.csv", [
        {"criterion": text, "relative_difference": "-2e-5", "verdict": "reproduced"},
        {"criterion": text, "relative_difference": "1e-6", "verdict": "reproduced with erratum 2"},
        {"criterion": "other", "relative_difference": "", "verdict": "deviates"},
    ])  # fmt: skip
    found = summary.opening(tmp_path)
    assert "Of 3 claims that are checked, 2 are reproduced, 1 of these with an erratum" in found
    assert "deviating: 1." in found
    assert "The 2 printed errors of full SPH differ by at most 2.0e-05 of their values." in found
    gain = "speedup_against_fastest_full_model"
    row = {"scene": "a", "modes": "8", "error_velocity": "0.01", gain: "40", "machine": "one"}
    write(tmp_path / "benchmark.csv", [
        row, {**row, gain: "90", "error_velocity": "0.5"}, {**row, gain: "900", "modes": "0"},
        {**row, gain: "800", "error_velocity": ""},
        {**row, "scene": "b", gain: "20"},
    ])  # fmt: skip
    assert "take 1/20 to 1/40 of the time" in summary.opening(tmp_path)
