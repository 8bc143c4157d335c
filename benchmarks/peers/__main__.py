"""``python -m benchmarks.peers``: compare all tools, on a scene and on a survey of parameters."""

import sys

from benchmarks.peers import run, survey, table
from benchmarks.peers.problem import Problem


def main() -> int:
    """Exit status: 1 if a full model disagreed, else 0."""
    problem, entries, disagreements = Problem.load(), [], []
    for contender in run.contenders(problem):
        try:
            entry = run.enter(problem, contender)
        except run.Disagreement as error:
            disagreements.append(str(error))
            print(error, file=sys.stderr)
            continue
        entries.append(entry)
        errors = ", ".join(f"{name} {error:.2e}" for name, error in entry.errors.items())
        print(f"{contender}: error against {errors}", flush=True)
    print(f"Times: {run.REPEATS} turns", flush=True)
    seconds = run.take_times(problem, entries, run.REPEATS)
    rows = list(run.rows(entries, seconds))
    if obstacle := run.pysph_obstacle():
        print(obstacle)
        rows.append(dict.fromkeys(rows[0]) | {"tool": "pysph", "note": obstacle})
    table.write("results/peers", rows, run.field_seconds(problem), disagreements)
    print("Written: results/peers.csv, results/peers.md")
    survey.main()
    return 1 if disagreements else 0


if __name__ == "__main__":
    sys.exit(main())
