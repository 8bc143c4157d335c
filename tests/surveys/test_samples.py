"""Queries: the same ones in parts as in one piece, within the ranges."""

import numpy as np
import pytest
from survey_cases import SCENE

from sphpod.surveys import answers, samples

RANGES = SCENE["parameters"]
DRAWN = [
    {"count": 100, "sampling": sampling, "seed": 3}
    for sampling in ("sobol", "halton", "latin_hypercube", "uniform")
]


@pytest.mark.parametrize("queries", [*DRAWN, {"grid": {"stiffness": 7, "decay": 5}}])
@pytest.mark.parametrize("size", [1, 13, 200])
def test_parts_are_those_of_the_whole(queries, size) -> None:
    whole = samples.points(RANGES, queries)
    count = samples.count(RANGES, queries)
    assert len(whole) == count
    parts = [samples.points(RANGES, queries, n, n + size) for n in range(0, count, size)]
    assert np.concatenate(parts).tobytes() == whole.tobytes()
    low, high = np.array([given["range"] for given in RANGES.values()]).T
    assert np.all((low <= whole) & (whole <= high))


def test_a_table_is_cut_as_it_stands(tmp_path) -> None:
    rows = samples.points(RANGES, DRAWN[0])[:20]
    path = tmp_path / "mine.csv"
    np.savetxt(path, rows, "%.17g", ",", header=",".join(RANGES), comments="")
    assert samples.count(RANGES, {"from": str(path)}) == 20
    assert np.array_equal(samples.points(RANGES, {"from": str(path)}, 5, 12), rows[5:12])


def test_a_grid_has_the_last_parameter_change_first() -> None:
    found = samples.points(RANGES, {"grid": {"stiffness": 2, "decay": 3}})
    assert found[:, 2].tolist() == [0, 0.5, 1] * 2
    np.testing.assert_allclose(found[:, 0], np.repeat([0.05, 0.2], 3), rtol=1e-15)
    assert np.all(found[:, 1] == 0.3)


def test_a_few_of_very_many_queries_are_made_alone() -> None:
    chunk = answers.chunk_points(
        {"chunk_size": 10, "queries": {"grid": {"stiffness": 10**4, "decay": 10**8}}},
        RANGES,
        10**11 - 1,
    )
    assert chunk[-1].tolist() == [0.2, 0.3, 1]


def test_joined_chunks_are_read_one_at_a_time() -> None:
    survey = {"queries": {"count": 5}}
    held = []

    def chunks():
        for n in (0, 2, 4):
            part = np.arange(n, min(n + 2, 5))
            held.append(n)
            yield {
                "t": np.zeros(3),
                "reason": np.array(["", "the line may fold"])[part % 2],
                "history": part[:, None] + np.zeros(3),
            }

    every = answers.joined(survey, RANGES, chunks())
    assert held == [0, 2, 4]
    assert every["history"][:, 0].tolist() == [0, 1, 2, 3, 4]
    assert every["reason"].tolist() == ["", "the line may fold"] * 2 + [""]
