"""Spectra of reduced operators: which Galerkin projection can grow by itself, and which cannot.

Projected in the energy, the operator of a lifted model is M = [[-D, B], [-Bᵀ, 0]]. As M + Mᵀ is
-2 diag(D, 0) ⪯ 0, real parts of its eigenvalues are not positive, for any modes. Nor does rounding
magnify: if M is known up to E, no real part is above |E|, since zᴴ (M + E) z has none for |z| = 1.

The paper projects velocity and density in plain sums over particles. At rest its operator is
[[0, X], [Y, 0]] with X = -Φᵀ diag(1/ρ0) G diag(c/ρ0) Ψ and Y = -Ψᵀ diag(ρ0) G Φ, whose eigenvalues
are the roots of those of X Y. On even particles whose ρ0 and c are all the same, X is -(c/ρ0³) Yᵀ,
so X Y is symmetric and not positive, and plain bases are as good as those of the energy. Where ρ0
or c vary, or coefficients are those of another density than ρ0, X Y is not symmetric, and may have
positive or complex eigenvalues: one of their roots has a positive real part, and the model grows
however short its steps are.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sphpod.full import energy, lifted
from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import meanings
from sphpod.reduced import lifted_rom
from sphpod.reduced.lifted_rom import LiftedModel
from sphpod.reduced.rom import ReducedModel, galerkin, modes_resolved
from sphpod.scene.scene import Scene
from sphpod.studies.study import (
    RUN,
    WITHOUT_FREE_ENDS,
    Dataset,
    Drawing,
    Need,
    Study,
    sampled,
    scenes,
)

RANDOM_MODES = 20
"""Largest number of modes of a random basis, of velocity and of density each."""

EXAMPLE_MODES = 8
"""Random modes of the example, for velocity and density each, beside the initial state."""

EXAMPLE_DRAWS = 100
"""Random bases of which the example takes the one that grows fastest."""

EXAMPLE_TIMES, EXAMPLE_OUTPUTS = 8, 1000
"""Growth times 1/rate that the example lasts, and its outputs."""

CLEAR_GROWTH = 1e-6
"""Part of an operator's size from which a rate of the paper's form is not taken for rounding, which
moves a double eigenvalue by the root of the machine's precision."""

Spectrum = tuple[float, float]
"""Largest real part of a spectrum, and how far rounding may have moved it [1/s]."""


def growth_rate(operator: np.ndarray) -> float:
    """Largest real part of the spectrum of an operator (n, n) [1/s]."""
    return float(np.linalg.eigvals(operator).real.max())


def rounding_bound(order: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Largest real part of a lifted operator that rounding explains [1/s].

    Eigenvalues are those of an operator that differs by rounding errors, whose norm is a small
    multiple of the machine's precision times the operator's; the order of the operator is taken.

    Parameters
    ----------
    order : int array
        Rows of the operator.
    size : array
        Its 2-norm [1/s].
    """
    return order * np.finfo(float).eps * size


def conditioned_rate(operator: np.ndarray) -> Spectrum:
    """Largest real part of any operator, and what rounding may have done to it, to first order.

    An eigenvalue moves by at most |E|/|yᴴ x| where the operator is off by E, with left and right
    eigenvectors y and x of unit length. A double eigenvalue that has one eigenvector moves by the
    root of |E|, as these numbers also show: then yᴴ x is of the order of that root.

    Returns
    -------
    rate, rounding : float
        In 1/s.
    """
    from scipy.linalg import eig

    values, left, right = eig(operator, left=True)
    fastest = int(values.real.argmax())
    overlap = abs(np.vdot(left[:, fastest], right[:, fastest]))
    error = np.finfo(float).eps * np.linalg.norm(operator, 2)
    return float(values[fastest].real), float(error / max(overlap, np.sqrt(np.finfo(float).eps)))


def of_samplings(
    scene: Scene, mode_counts: Iterable[int], modes: Arrays, energy_modes: Arrays, snapshots: Arrays
) -> dict[str, np.ndarray]:
    """Growth rates of the paper's and of lifted reduced models on POD modes.

    Parameters
    ----------
    mode_counts : ints
        Modes for velocity and density each, or all there are.
    modes, energy_modes : dict
        As from `pod.decompose` and `lifted_rom.decompose`.
    snapshots : dict
        density_snapshots (n, N): densities that coefficients are frozen at [kg/m³].

    Returns
    -------
    dict
        mode_count; modes_resolved, of both kinds of modes; and what `STUDY` describes of each mode
        count. euclidean_growth_rate is the larger one of the original and of the frozen model about
        the initial density as the density modes hold it.
    """
    counts = list(mode_counts)
    found = []
    for count in counts:
        rows = modes["velocity_modes"][:count], modes["density_modes"][:count]
        original, frozen = (ReducedModel(scene, name, *rows) for name in ("original", "frozen10"))
        at_rest = max(conditioned_rate(model.operator()) for model in (original, frozen))
        strained = (frozen.operator(density) for density in snapshots["density_snapshots"])
        fastest = max(strained, key=growth_rate)
        operator = lifted_rom.build(scene, energy_modes, count).operator
        found.append((*at_rest, *conditioned_rate(fastest), growth_rate(operator), _size(operator)))
    names = (
        "euclidean_growth_rate", "euclidean_rounding", "frozen_growth_rate", "frozen_rounding",
        "energy_growth_rate", "operator_size",
    )  # fmt: skip
    resolved = modes_resolved(modes, counts) & lifted_rom.modes_resolved(energy_modes, counts)
    return {
        "mode_count": np.array(counts),
        "modes_resolved": resolved,
        **dict(zip(names, np.array(found).T, strict=True)),
    }


def _size(operator):
    return float(np.linalg.norm(operator, 2))


def of_random_bases(scene: Scene, count: int, seed: int) -> dict[str, np.ndarray]:
    """Growth rates on random orthonormal modes, the same for both kinds of projection.

    Plain fields take them in one, scaled fields in the other. The paper's operator is the one about
    the initial density itself, of which random modes hold next to nothing.

    Parameters
    ----------
    count : int
        How many bases; each has up to `RANDOM_MODES` modes of velocity, and as many or not of
        density or strain.

    Returns
    -------
    dict
        What `STUDY` describes of bases; modes of velocity and of density are counted together.
    """
    rng = np.random.default_rng(seed)
    density0 = scene.density0()
    largest = min(RANDOM_MODES, scene.particle_count)
    found = np.empty((count, 4))
    for n, (kv, kr) in enumerate(rng.integers(1, largest, (count, 2), endpoint=True)):
        rows = (
            _orthonormal(rng.standard_normal((kv, density0.size))),
            _orthonormal(rng.standard_normal((kr, density0.size))),
        )
        plain = ReducedModel(scene, "original", *rows).operator(density0)
        lifted_operator = LiftedModel(scene, *rows, 0).operator
        found[n] = kv + kr, growth_rate(plain), growth_rate(lifted_operator), _size(lifted_operator)
    return {
        "basis_mode_count": found[:, 0].astype(int),
        "random_euclidean_growth_rate": found[:, 1],
        "random_energy_growth_rate": found[:, 2],
        "random_operator_size": found[:, 3],
    }


def _orthonormal(rows):
    """Orthonormal rows of the same span, of which the first keeps its direction."""
    return np.ascontiguousarray(np.linalg.qr(rows.T)[0].T)


def example(scene: Scene, seed: int) -> dict[str, np.ndarray]:
    """A run of the paper's model that grows, and of the lifted model in the same modes.

    Of random modes beside the initial velocity and the initial density, so that the model starts
    as the scene does and rests where the scene rests, those whose operator grows fastest are taken.
    The lifted model projects on the same functions, orthonormal in the energy. Both take explicit
    Euler steps, so short that those let the fastest wave grow a hundred times more slowly than the
    operator itself.

    Parameters
    ----------
    scene : Scene
        Undamped and unforced; ρ0 or c vary.

    Returns
    -------
    dict
        As from `long_run`; example_growth_rate and example_time_step, as `STUDY` describes them.
    """
    rng = np.random.default_rng(seed)
    models = [_random_model(scene, rng) for _ in range(EXAMPLE_DRAWS)]
    model = max(models, key=lambda model: growth_rate(model.operator()))
    operator = model.operator()
    rate, size = growth_rate(operator), np.abs(np.linalg.eigvals(operator)).max()
    interval = EXAMPLE_TIMES / rate / EXAMPLE_OUTPUTS
    step = interval / np.ceil(interval / (2e-2 * rate / size**2))
    short = replace(scene, duration=EXAMPLE_TIMES / rate, time_step=step, error_interval=interval)
    mass, stiffness = lifted.energy_weights(scene)
    # The first density mode is the rest, in which there is no strain.
    strains = model.density_modes[1:] / scene.density0()
    energetic = LiftedModel(
        short, _orthonormal(model.velocity_modes * mass), _orthonormal(strains * stiffness), 0
    )
    return _energies(replace(model, scene=short), energetic) | {
        "example_growth_rate": np.array(rate),
        "example_time_step": np.array(step),
    }


def long_run(
    scene: Scene, mode_count: int, modes: Arrays, energy_modes: Arrays, horizon: float
) -> dict[str, np.ndarray]:
    """Energies of the original and of the lifted model in POD modes, over a long time.

    Where the density modes do not hold the initial density, the paper's model is not at rest when
    the scene is: a constant force of what they miss acts on it, its velocity and density drift, and
    with the density the coefficients. The strain of a lifted model is zero at rest, in any modes.

    Parameters
    ----------
    scene : Scene
        Undamped and unforced; both models take explicit Euler steps of its time step.
    mode_count : int
        Modes for velocity and density each, or all there are.
    modes, energy_modes : dict
        As from `pod.decompose` and `lifted_rom.decompose`.
    horizon : float
        Time [s].

    Returns
    -------
    dict
        t (times,); paper_energy, lifted_energy (times,) [J/m²], the former NaN from its breakdown
        on.
    """
    long = replace(scene, duration=horizon, error_interval=horizon / EXAMPLE_OUTPUTS)
    return _energies(
        galerkin(long, "original", modes, mode_count),
        lifted_rom.build(long, energy_modes, mode_count),
    )


def _energies(paper, energetic):
    """Energies of both models over time; NaN from the breakdown of the paper's on."""
    scene = paper.scene
    run = paper.prepare(scene.error_steps).run()
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        velocity, density = run.fields().values()
        paper_energy = energy.total(scene, velocity, lifted.strain(scene, density))
    if (broken := run.breakdown()) is not None:
        paper_energy[scene.error_times >= broken.time] = np.nan
    (state,) = energetic.prepare("lifted_euler").solve().state
    return {
        "t": scene.error_times,
        "paper_energy": paper_energy,
        # Own coordinates of an undamped lifted model are orthogonal.
        "lifted_energy": (state**2).sum(axis=0) / 2,
    }


def _random_model(scene, rng):
    first = scene.velocity0(), scene.density0()
    rows = (
        _orthonormal(np.vstack([row, rng.standard_normal((EXAMPLE_MODES, row.size))]))
        for row in first
    )
    return ReducedModel(scene, "original", *rows)


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """Rows of a table, one for each number of modes."""
    for n, count in enumerate(arrays["mode_count"]):
        counted = ("mode_count", "modes_resolved")
        numbers = {name: float(arrays[name][n]) for name in arrays if name not in counted}
        resolved = bool(arrays["modes_resolved"][n])
        yield {**place, "modes": int(count), "modes_resolved": resolved, **numbers}


def random_rows(place: Mapping[str, Any], arrays: Arrays) -> list[dict[str, Any]]:
    """The row of a table for the random bases of a scene: the worst of each number.

    Beside it stands how many bases there are, and grow by more than rounding explains.
    """
    plain, energetic, size = (
        arrays[f"random_{name}"]
        for name in ("euclidean_growth_rate", "energy_growth_rate", "operator_size")
    )
    row = {
        **place,
        "modes": int(arrays["basis_mode_count"].max()),
        "euclidean_growth_rate": float(plain.max()),
        "energy_growth_rate": float(energetic.max()),
        "operator_size": float(size.max()),
        "bases": plain.size,
        "euclidean_growing": int(np.count_nonzero(plain > CLEAR_GROWTH * size)),
        "energy_growing": int(
            np.count_nonzero(energetic > rounding_bound(arrays["basis_mode_count"], size))
        ),
    }
    return [row]


def _runs(config, study, *keys):
    """The place of a run, if one is configured."""
    run = config["stability"].get(study)
    return [tuple(run[key] for key in keys)] if run else []


GRADED: Need = (
    lambda scene: RUN[0](scene) and bool(np.ptp(scene.density0()) + np.ptp(scene.modulus())),
    f"{RUN[1]}, whose density or modulus varies",
)
"""A scene of which a model of random modes may grow."""


STUDY = Study(
    datasets={
        "operators": Dataset(
            compute="studies.operators.of_samplings",
            message="{scene}: spectra of reduced operators, snapshots {sampling}",
            of_sampling=True,
            reads={"modes": "pod.nc", "energy_modes": "lifted_pod.nc", "snapshots": "snapshots.nc"},
            arguments={"mode_counts": "all_mode_counts"},
            needs=WITHOUT_FREE_ENDS,
            places=sampled,
        ),
        "random_bases": Dataset(
            compute="studies.operators.of_random_bases",
            message="{scene}: spectra of reduced operators of random bases",
            arguments={"count": "stability.random_bases", "seed": "seed"},
            places=scenes,
        ),
        "random_run": Dataset(
            compute="studies.operators.example",
            message="{scene}: a run of random modes that grows",
            arguments={"seed": lambda scene, setting: 0},
            needs=GRADED,
            places=lambda config: _runs(config, "random_run", "scene"),
        ),
        "long_run": Dataset(
            compute="studies.operators.long_run",
            message="{scene}: a long run with {modes} modes of {sampling}",
            of_sampling=True,
            of_modes=True,
            reads={"modes": "pod.nc", "energy_modes": "lifted_pod.nc"},
            arguments={
                "mode_count": "modes",
                "horizon": lambda scene, setting: (
                    max(setting("stability.horizon_factors")) * scene.duration
                ),
            },
            needs=RUN,
            places=lambda config: _runs(config, "long_run", "scene", "sampling", "mode_count"),
        ),
    },
    tables={
        "operators": ("studies.operators.rows", "operators"),
        "random_bases": ("studies.operators.random_rows", "random_bases"),
    },
    drawing=Drawing(
        draw="figures.stability_plots.operators",
        caption="Largest real parts of reduced operators, and runs of models that grow.",
        reads={
            "samplings": ("operators",),
            "random": ("random_bases",),
            "runs": ("random_run", "long_run"),
        },
    ),
    variables=meanings(
        """
        euclidean_growth_rate (mode_count) [s-1]: largest real part of the paper's reduced operator
            at rest
        euclidean_rounding (mode_count) [s-1]: how far rounding may have moved that real part, to
            first order
        frozen_growth_rate (mode_count) [s-1]: the same with coefficients of the snapshots'
            densities, largest
        frozen_rounding (mode_count) [s-1]: how far rounding may have moved that one, to first order
        energy_growth_rate (mode_count) [s-1]: largest real part of the lifted reduced operator
        operator_size (mode_count) [s-1]: 2-norm of the lifted reduced operator
        basis_mode_count (basis) [1] int32: modes of a random basis
        random_euclidean_growth_rate (basis) [s-1]: largest real part of the paper's operator on
            random modes
        random_energy_growth_rate (basis) [s-1]: largest real part of the lifted operator on random
            modes
        random_operator_size (basis) [s-1]: 2-norm of the lifted operator on random modes
        paper_energy (t) [J m-2]: energy of the paper's reduced model
        lifted_energy (t) [J m-2]: energy of the lifted reduced model
        example_growth_rate () [s-1]: largest real part of the paper's operator of these modes
        example_time_step () [s]: time step of explicit Euler of both models
        """
    ),
)
