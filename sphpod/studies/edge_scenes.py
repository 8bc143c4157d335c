"""What must hold of any scene, checked where scenes are at the edge of what can be computed.

Energy. What integrators keep in its place (`sphpod.full.energy`) is kept without damping, never
grows with it, and is the square of a norm for Δt < 2/ω with the fastest wave ω. With ρ = Δt ω/2, a
force then adds at most

    √H(t) ≤ √H(0) + (1 - ρ²)^(-1/2) Σ Δt |f| |√m|,    H twice the energy.

Momentum. Σ_i V_i G_ij = -V_j (G 1)_j is zero for evenly spaced particles, so that nothing but
damping and force changes their momentum. For jittered ones translation strains, the more the more
particles there are, as G 1 is of the size of jitter over spacing: how much is reported.

Reduced models. They have the same energy on any modes: their operators have no eigenvalue with a
positive real part, and their errors stay within the bounds of `sphpod.reduced.certificate`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sphpod.full import energy, lifted
from sphpod.numerics.error import Arrays
from sphpod.pipeline.dataset import meanings
from sphpod.reduced import certificate, lifted_rom
from sphpod.scene import waves
from sphpod.scene.breakdown import Breakdown
from sphpod.scene.checks import check_setting, check_step
from sphpod.scene.scene import Scene, derivative_matrix, step_times
from sphpod.scene.waves import GROWTH_LIMIT
from sphpod.studies.machine import seldom_shown
from sphpod.studies.study import Dataset, Study

INTEGRATORS = ("exact", "leapfrog", "symplectic_euler")
"""Integrators that a scene at the edge is computed with, each at a step that it needs."""

STEP = 0.9
"""Time step, of the largest that is stable for the fastest wave."""

VALUES = 4_000_000
"""Values of a field that are kept at most; outputs are farther apart where there would be more."""

SNAPSHOTS = 20
"""Snapshots of the lifted full model, evenly spread over the duration, the end excluded."""

MODES = 8
"""Velocity modes of the reduced model, or all there are."""

KEPT = 1e-10
"""Part of an energy or a momentum by which rounding may change it over a run."""

ROUNDING = 1e-12
"""Part that rounding may change from one output to the next, or in one product."""


class Check(NamedTuple):
    """Something found of a model of a scene, and what it must not exceed."""

    check: str
    model: str
    value: float
    limit: float


def study(scene: Scene) -> dict[str, np.ndarray]:
    """Run every check that makes sense for a scene; the cost of a step is linear in N.

    Parameters
    ----------
    scene : Scene
        Its own time step is that of explicit Euler alone.

    Returns
    -------
    dict
        check, check_model, check_value, check_limit, each (checks,). A check holds where its value
        is at most its limit; with an infinite limit the value is only reported.

    Raises
    ------
    ValueError
        The scene cannot be simulated, for another reason than explicit Euler's step.
    """
    found = [*explicit_euler(scene), *particles(scene)]
    scene = seldom_shown(scene, max(1, VALUES // scene.particle_count))
    for integrator in INTEGRATORS:
        time_step = stable_step(scene)
        try:
            solution = lifted.solve(scene, integrator, time_step)
        except Breakdown as breakdown:
            found.append(_broken(f"lifted full, {integrator}", breakdown))
            continue
        found.extend(full(scene, integrator, time_step, solution))
        if integrator == "exact" and (solution["velocity"].any() or solution["strain"].any()):
            found.extend(reduced(scene, solution))
    columns = zip(*found, strict=True)
    return {
        name: np.array(values)
        for name, values in zip(
            ("check", "check_model", "check_value", "check_limit"), columns, strict=True
        )
    }


def rows(place: Mapping[str, Any], arrays: Arrays) -> Iterator[dict[str, Any]]:
    """The checks of a scene, a row each: holds, fails or, without limit, reported."""
    names = ("check", "check_model", "check_value", "check_limit")
    for what, model, value, limit in zip(*(arrays[name] for name in names), strict=True):
        verdict = "holds" if value <= limit else "fails"
        yield {
            **place,
            "model": str(model),
            "check": str(what),
            "value": float(value),
            "limit": float(limit),
            "verdict": verdict if np.isfinite(limit) else "reported",
        }


def stable_step(scene: Scene) -> float:
    """Time step [s] of leapfrog and symplectic Euler that divides the error interval."""
    longest = STEP * 2 / waves.fastest_wave(scene)
    return scene.error_interval / np.ceil(scene.error_interval / longest)


def work(scene: Scene, integrator: str, time_step: float) -> np.ndarray:
    """What the force has added at most to √H by each output, (times,)."""
    mass, _ = lifted.energy_weights(scene)
    stride = round(scene.error_interval / time_step)
    count = stride * (scene.error_times.size - 1)
    halves = 2 * np.arange(count + 1) + (integrator == "leapfrog")
    amplitudes, profiles = scene.force_values(step_times(time_step, halves, 2))
    if integrator == "exact":
        # Of the integral of |f| an upper sum, or rounding would decide where force alone acts.
        grid = step_times(time_step, np.arange(count + 1))
        added = np.array([np.diff(one.impulse(grid)[::stride]) for one in scene.courses()])
    else:
        starts = np.arange(0, count, stride)
        added = np.add.reduceat(np.abs(amplitudes[:, :-1]), starts, axis=1) * time_step
        added /= np.sqrt(1 - (time_step * waves.fastest_wave(scene) / 2) ** 2)
    reach = np.linalg.norm(mass * profiles, axis=1)
    return np.concatenate([[0.0], np.cumsum(reach @ added)])


def full(scene: Scene, integrator: str, time_step: float, solution: Arrays) -> Iterator[Check]:
    """Checks of a solution of the lifted full model."""
    model = f"lifted full, {integrator}"
    kept = energy.kept(scene, integrator, time_step, solution["velocity"], solution["strain"])
    damping = scene.damping_values()
    start = kept[0] or 1.0
    if scene.forces:
        root = np.sqrt(np.maximum(2 * kept, 0))
        reach = root[0] + work(scene, integrator, time_step)
        shares = np.divide(root, reach, out=np.zeros_like(root), where=reach > 0)
        yield Check("energy's root, of what the force can reach", model, shares[1:].max(), 1 + KEPT)
    elif damping.size:
        growth = np.diff(kept).max() / start
        yield Check("energy's growth from output to output", model, growth, ROUNDING)
    else:
        drift = np.abs(kept - kept[0]).max() / start
        yield Check("energy's drift", model, drift, KEPT)
    if not scene.forces and (not damping.size or damping.min() == damping.max()):
        mass = scene.density0() * scene.volumes
        decay = np.exp(-damping[0] * scene.error_times) if damping.size else 1.0
        change = np.abs(solution["velocity"] @ mass - decay * (mass @ scene.velocity0())).max()
        change /= mass @ np.abs(scene.velocity0()) or 1.0
        limit = KEPT if scene.is_even else np.inf
        yield Check("momentum's change, of Σ m |v0|", model, change, limit)
    yield _squeezing(model, solution["strain"])


def reduced(scene: Scene, solution: Arrays) -> Iterator[Check]:
    """Checks of a lifted reduced model from snapshots of the exact lifted full model."""
    every = max(1, (len(solution["t"]) - 1) // SNAPSHOTS)
    taken = slice(0, len(solution["t"]) - 1, every)
    snapshots = {f"{field}_snapshots": solution[field][taken] for field in ("velocity", "strain")}
    modes = lifted_rom.decompose(scene, snapshots)
    model = lifted_rom.build(scene, modes, MODES)
    name = f"lifted reduced, exact, k = {len(model.velocity_modes)}"
    operator = model.operator
    growth = np.linalg.eigvals(operator).real.max() / (np.linalg.norm(operator, 2) or 1.0)
    yield Check("largest real part, of the operator's norm", name, growth, ROUNDING)
    reference = {
        "velocity": solution["velocity"],
        "density": lifted.density(scene, solution["strain"]),
    }
    try:
        certified = certificate.certify(scene, [MODES], modes, solution, reference)
    except Breakdown as breakdown:
        yield _broken(name, breakdown)
        return
    error, bound = (certified[f"energy_error_{of}"][0] for of in ("lifted", "bound"))
    excess = -certified["bound_slack"][0]
    yield Check("largest error, and its bound", name, error, bound + KEPT)
    yield Check("error above its bound, at any output", name, excess, KEPT)
    _, stiffness = lifted.energy_weights(scene)
    strain = certified["scaled_strain_coordinates"] @ (model.strain_modes / stiffness)
    yield _squeezing(name, strain)


def explicit_euler(scene: Scene) -> Iterator[Check]:
    """Whether the scene's own step, that of explicit Euler, is refused; how it grows if not.

    Without damping the growth of the fastest wave bounds that of every solution; with it waves are
    not orthogonal, and the growth of a solution has no such bound.
    """
    model = "full SPH, explicit Euler"
    check_setting(scene)
    try:
        check_step(scene)
    except ValueError as refusal:
        share = GROWTH_LIMIT / waves.growth_factor(scene)
        yield Check(f"refused: {refusal}", model, share, 1)
        return
    growth = waves.growth_factor(scene)
    yield Check("growth of any wave, of the allowed", model, growth / GROWTH_LIMIT, 1)
    if not scene.forces:
        ends = replace(scene, error_interval=scene.duration)
        try:
            solution = lifted.solve(ends, "explicit_euler")
        except Breakdown as breakdown:
            yield _broken("lifted full, explicit_euler", breakdown)
            return
        first, last = energy.total(ends, solution["velocity"], solution["strain"])
        grown = np.sqrt(last / (first or 1.0))
        limit = growth * (1 + KEPT) if scene.is_conservative else np.inf
        yield Check("growth of energy's root", "lifted full, explicit_euler", grown, limit)


def particles(scene: Scene) -> Iterator[Check]:
    """Checks of the SPH derivative on the scene's particles."""
    from scipy.sparse import diags_array

    weighted = diags_array(scene.volumes) @ derivative_matrix(scene)
    # Positions are rounded to a part of the domain, which is N parts of a spacing.
    rounding = 8 * np.finfo(float).eps * scene.particle_count
    size = np.abs(weighted.data).max()
    uneven = np.abs((weighted + weighted.T).data).max(initial=0) / size
    yield Check("asymmetry of V_i G_ij", "particles", uneven, rounding)
    share = waves.translation_strain(scene)
    limit = ROUNDING if scene.is_even else np.inf
    yield Check("strain by translation, of that by the longest wave", "particles", share, limit)


def _squeezing(model, strain):
    """1 - J of the particle that is squeezed most."""
    return Check("largest squeezing 1 - J", model, float(-strain.min(initial=0)), 1.0)


def _broken(model, breakdown):
    what = f"largest squeezing 1 - J, or not finite: broke down by t = {breakdown.time:.6g} s"
    return Check(f"{what} at particle {breakdown.particle}", model, np.inf, 1.0)


STUDY = Study(
    datasets={
        "edge_scenes": Dataset(
            compute="studies.edge_scenes.study",
            message="{scene}: what must hold of a scene at the edge",
            places=lambda config: [(name,) for name in config["stability"]["edge_scenes"]],
            own_scenes="stability.edge_scenes",
        )
    },
    tables={"edge_scenes": ("studies.edge_scenes.rows", "edge_scenes")},
    variables=meanings(
        """
        check (check_index): what is checked of a scene at the edge
        check_model (check_index): model that is checked
        check_value (check_index) [1]: what was found
        check_limit (check_index) [1]: what it must not exceed
        """
    ),
)
