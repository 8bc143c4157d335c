"""Compiled kernels."""

import re

import pytest
from numba.core.dispatcher import Dispatcher
from scenes import VARIED, scene

from sphpod.full import coefficients_in_time, lifted, sph
from sphpod.numerics import oscillators, propagator
from sphpod.reduced import lifted_rom, pod, reduced_in_time, rom, snapshots
from sphpod.reference import chain, reference

SAMPLING = {"range": [0, 1], "count": 25}
SCENES: tuple[dict, ...] = (
    {},
    {"damping": 3, "force": "1e-3*cos(9*t)"},
    VARIED,
    {"smoothing_ratio": 1.7},
    {"smoothing_ratio": 3.3},
    {"youngs_modulus": "where(x < L/2, 0.1, 0.2)", "interface": "mean"},
    {
        "youngs_modulus": "0.1 + 0.01*sin(t + 2*pi*x/L)",
        "damping": "1 + cos(t)*sin(2*pi*x/L)",
        "force": ["1e-3*sin(t)", "1e-3*sin(2*pi*x/L - t)"],
    },
    {"force": "1e-3*exp(-((x - t/5 - 0.4)/0.05)**2)"},
    {"force": "where(t < 0.4137, 0, 1e-3)"},
)


@pytest.mark.slow
def test_every_kernel_has_one_signature(monkeypatch):
    """Only so can jobs that compile the same kernel at once not spoil each other's cache."""
    for changes in SCENES:
        case = scene(**changes)
        steps = snapshots.output_steps(case, [SAMPLING])
        full = sph.solve(case, steps)
        sph.solve(case, case.error_steps, "lists")
        reference.solve_paper(case)
        reference.solve_centred(case)
        chain.solve(case)
        for integrator in lifted.INTEGRATORS:
            lifted.solve(case, integrator)
        taken = snapshots.extract(case, SAMPLING, full)
        modes, energy_modes = pod.decompose(taken), lifted_rom.decompose(case, taken)
        for ill_conditioned in (1e6, 0):
            monkeypatch.setattr(lifted_rom, "ILL_CONDITIONED", ill_conditioned)
            for method in lifted_rom.METHODS:
                for count in (2, 3, 7):
                    lifted_rom.build(case, energy_modes, count).prepare(method).solve()
        for cheaper in (True, False):
            monkeypatch.setattr(rom, "tensor_is_cheaper", lambda *_, cheaper=cheaper: cheaper)
            for method in ("original", "linearized", "frozen1", "frozen3"):
                models = [rom.galerkin(case, method, modes, k) for k in (1, 2, 3, 7)]
                for run in rom.prepare_each(models, case.error_steps):
                    run.run().breakdown()
    kernels = {
        f"{module.__name__}.{name}": kernel
        for module in (
            sph,
            reference,
            chain,
            rom,
            lifted,
            propagator,
            oscillators,
            coefficients_in_time,
            reduced_in_time,
        )
        for name, kernel in vars(module).items()
        if isinstance(kernel, Dispatcher)
    }
    # A kernel that only others call has none where these come from the cache.
    assert {name for name, kernel in kernels.items() if len(kernel.signatures) > 1} == set()
    entries = [kernel for name, kernel in kernels.items() if re.search(r"\.(march|rates_of)", name)]
    assert [len(kernel.signatures) for kernel in entries] == [1] * 12
