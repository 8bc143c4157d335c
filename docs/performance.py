"""Write the tables of docs/performance.md that are of one run: `make performance`.

The target `benchmarks` comes first. The text around the tables names the machine and ratios: it is
to be read again.
"""

from pathlib import Path

import pandas as pd

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/performance.md"
SCENES = ("ten_harmonics", "damped", "damped_forced", "two_moduli", "mildly_damped_forced")
AS_ACCURATE = 1.1
"""Errors that are larger by no more count as those of SPH, as in the figures."""


def small(value):
    """An error with two digits, such as 4.7e-2."""
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def short(value):
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def both(row, against=""):
    """Errors of velocity and density of a run."""
    return ", ".join(small(row[f"error_{field}{against}"]) for field in ("velocity", "density"))


def ms(row):
    spread = 1e3 * row.cpu_seconds_interquartile_range
    return f"{short(1e3 * row.cpu_seconds)} ({short(spread)})"


def ratio(value):
    return f"{value:.2f}" if value < 2 else f"{value:.2g}" if value < 100 else f"{value:.0f}"


def fastest(runs):
    return runs.loc[runs.cpu_seconds.idxmin()]


def lifted(runs):
    return runs[runs.method.isin(["lifted_euler", "lifted_exact"])]


def beside_frozen(table):
    """The paper's fastest reduced model, and the fastest lifted one that is as accurate."""
    for scene in SCENES:
        runs = table[table.scene == scene]
        euler = runs[runs.speedup_against_fastest_explicit_euler == 1].iloc[0]
        frozen = runs[runs.method == "frozen10"].sort_values("modes")
        usual = {"ten_harmonics": [12], "two_moduli": [5, 20], "mildly_damped_forced": [12]}
        for row in frozen[frozen.modes.isin(usual.get(scene, [8, 12]))].itertuples():
            good = lifted(runs)
            good = good[
                (good.error_velocity <= row.error_velocity)
                & (good.error_density <= row.error_density)
            ]
            best = fastest(good)
            fields = best.cpu_seconds_with_fields
            yield (
                f"`{scene}`, {runs.particle_count.iloc[0]}", row.modes,
                f"{small(row.error_velocity)}, {small(row.error_density)}",
                short(1e3 * row.cpu_seconds), f"`{best.method}`, {best.modes}", both(best),
                ms(best), ms(euler), ratio(euler.cpu_seconds / best.cpu_seconds),
                short(1e3 * fields), ratio(euler.cpu_seconds / fields),
            )  # fmt: skip


def beside_full(table):
    """SPH as the scene has it, the fastest full model, and the fastest lifted one."""
    for scene in SCENES:
        runs = table[table.scene == scene]
        sph = runs[(runs.method == "sph_stencil") & (runs.speedup_against_sph_stencil == 1)].iloc[0]
        good = runs[
            (runs.error_velocity_exact <= AS_ACCURATE * sph.error_velocity_exact)
            & (runs.error_density_exact <= AS_ACCURATE * sph.error_density_exact)
        ]
        full, best = fastest(good[good.modes == 0]), fastest(lifted(good))
        name = full.integrator.replace("_", " ").replace("euler", "Euler")
        step = f", Δt = {full.time_step:g} s" if full.time_step > 0 else ""
        fields = best.cpu_seconds_with_fields
        yield (
            f"`{scene}`", both(sph, "_exact"), short(1e3 * sph.cpu_seconds), f"{name}{step}",
            both(full, "_exact"), short(1e3 * full.cpu_seconds),
            ratio(sph.cpu_seconds / full.cpu_seconds), f"`{best.method}`, {best.modes}",
            both(best, "_exact"), short(1e3 * best.cpu_seconds),
            ratio(full.cpu_seconds / best.cpu_seconds), short(1e3 * fields),
            ratio(full.cpu_seconds / fields),
        )  # fmt: skip


def of_twelve(table):
    """All reduced models of the ten harmonics with twelve modes."""
    for row in table[(table.scene == "ten_harmonics") & (table.modes == 12)].itertuples():
        offline = (
            row.offline_snapshots_seconds, row.offline_modes_seconds, row.offline_projection_seconds
        )  # fmt: skip
        yield (
            f"`{row.method}`", f"{small(row.error_velocity)}, {small(row.error_density)}",
            f"{small(row.error_velocity_exact)}, {small(row.error_density_exact)}", ms(row),
            short(1e3 * row.cpu_seconds_with_fields), *(short(1e3 * s) for s in offline),
        )  # fmt: skip


def skipped(table):
    for row in table.itertuples():
        times = (
            f"{short(1e3 * seconds)} ({short(1e3 * spread)})"
            for seconds, spread in (
                (row.skipping_seconds, row.skipping_seconds_interquartile_range),
                (row.general_seconds, row.general_seconds_interquartile_range),
            )
        )
        yield row.skipped, row.model, *times, f"{row.general_over_skipping:.2f}"


def replaced(page, header, rows):
    """The page with other rows in the table whose header begins so."""
    start = page.index(f"| {header} |")
    head = page[start:].split("\n", 2)[:2]
    end = page.index("\n\n", start)
    lines = [f"| {' | '.join(map(str, row))} |" for row in rows]
    return page[:start] + "\n".join([*head, *lines]) + page[end:]


if __name__ == "__main__":
    benchmark = pd.read_csv(ROOT / "results/benchmark.csv")
    text = PAGE.read_text(encoding="utf-8")
    for first, made in (
        ("Scene, N | k", beside_frozen(benchmark)),
        ("Scene | SPH: v, ρ", beside_full(benchmark)),
        ("Method | v, ρ against SPH", of_twelve(benchmark)),
        ("Skipped | Model", skipped(pd.read_csv(ROOT / "results/skipping.csv"))),
    ):
        text = replaced(text, first, made)
    PAGE.write_text(text, encoding="utf-8")
