"""PySPH: full SPH from equations that it translates to C++; needs PySPH and a compiler.

Follows the PySPH documentation's pages "Writing equations" (equations, groups over ghost
particles), "Integrator module" (one_timestep, compute_accelerations) and "Module application". As
the particles stay where they are, neighbours are found once and kept (--cache-nnps), and a group of
equations carries the fields to the periodic ghosts, as PySPH's own gas dynamics do. With
EulerIntegrator, which makes ghosts and finds neighbours anew in each step, a step takes about five
times as long.
"""

import tempfile
from collections.abc import Iterator

import numpy as np
from compyle.api import declare
from pysph.base.kernels import CubicSpline
from pysph.base.nnps import DomainManager
from pysph.base.utils import get_particle_array
from pysph.solver.application import Application
from pysph.solver.solver import Solver
from pysph.sph.equation import Equation, Group
from pysph.sph.integrator import Integrator
from pysph.sph.integrator_step import IntegratorStep

from benchmarks.peers.contender import EULER, LONG, Contender, Model
from benchmarks.peers.problem import Problem


def contenders(problem: Problem) -> Iterator[Contender]:
    """Full SPH by explicit Euler."""
    yield Contender(
        "pysph",
        "full SPH, neighbours kept",
        f"explicit Euler, Δt = {problem.scene.time_step:g} s",
        lambda: _full(problem),
        check=EULER,
        part=LONG,
    )


class Stress(Equation):
    """Stress c (1 - ρ0/ρ) [Pa]."""

    def initialize(self, d_idx, d_stress, d_modulus, d_rho0, d_rho):
        d_stress[d_idx] = d_modulus[d_idx] * (1.0 - d_rho0[d_idx] / d_rho[d_idx])


class Ghosts(Equation):
    """Velocity and stress of a ghost are those of the particle that it stands for."""

    def initialize(self, d_idx, d_tag, d_original, d_u, d_stress):
        source = declare("int")
        if d_tag[d_idx] == 2:
            source = d_original[d_idx]
            d_u[d_idx] = d_u[source]
            d_stress[d_idx] = d_stress[source]


class Rates(Equation):
    """Rates of change of velocity and density, (2.10) and (2.11)."""

    def initialize(self, d_idx, d_au, d_arho):
        d_au[d_idx] = 0.0
        d_arho[d_idx] = 0.0

    def loop(self, d_idx, s_idx, d_au, d_arho, s_u, s_stress, s_volume, DWIJ):
        d_au[d_idx] += s_volume[s_idx] * s_stress[s_idx] * DWIJ[0]
        d_arho[d_idx] += s_volume[s_idx] * s_u[s_idx] * DWIJ[0]

    def post_loop(self, d_idx, d_au, d_arho, d_rho, d_rho0):
        d_au[d_idx] = -d_au[d_idx] / d_rho0[d_idx]
        d_arho[d_idx] = -d_rho[d_idx] * d_rho[d_idx] / d_rho0[d_idx] * d_arho[d_idx]


class EulerStep(IntegratorStep):
    """Both fields from the old rates; positions stay."""

    def stage1(self, d_idx, d_u, d_rho, d_au, d_arho, dt):
        d_u[d_idx] += dt * d_au[d_idx]
        d_rho[d_idx] += dt * d_arho[d_idx]


class LagrangianEuler(Integrator):
    """Explicit Euler without a search for neighbours."""

    def one_timestep(self, t, dt):
        self.compute_accelerations(0, False)
        self.stage1()


class Line(Application):
    """The scene over its first error intervals; ``kept`` holds the velocities (outputs, N)."""

    def __init__(self, problem, intervals):
        self.problem, self.intervals = problem, intervals
        self.kept = np.empty((intervals + 1, problem.count))
        self.kept[0] = problem.scene.velocity0()
        super().__init__(fname="line", output_dir=tempfile.mkdtemp(prefix="pysph_line_"))

    def create_domain(self):
        return DomainManager(xmin=0.0, xmax=self.problem.scene.domain_length, periodic_in_x=True)

    def create_particles(self):
        scene, problem = self.problem.scene, self.problem
        particles = get_particle_array(
            name="line",
            # Half a spacing off the ends of the domain, where rounding would decide on the side.
            x=scene.positions + scene.spacing / 2,
            m=problem.density0 * scene.spacing,
            h=scene.smoothing_length,
            u=scene.velocity0(),
            rho=problem.density0,
            rho0=problem.density0,
            volume=scene.spacing,
            modulus=problem.modulus,
            additional_props=["rho0", "volume", "modulus", "stress", "arho"],
        )
        particles.add_property("original", type="int", data=np.arange(problem.count))
        return [particles]

    def create_solver(self):
        scene = self.problem.scene
        return Solver(
            kernel=CubicSpline(dim=1),
            dim=1,
            integrator=LagrangianEuler(line=EulerStep()),
            dt=scene.time_step,
            tf=self.intervals * scene.error_interval,
            fixed_h=True,
        )

    def create_equations(self):
        return [
            Group([Stress("line", None)]),
            Group([Ghosts("line", None)], real=False),
            Group([Rates("line", ["line"])]),
        ]

    def post_step(self, solver):
        interval, rest = divmod(solver.count + 1, self.problem.scene.error_stride)
        if not rest:
            self.kept[interval] = self.particles[0].u[: self.problem.count]


def _full(problem):
    def prepare(intervals):
        """Solvers run once, so each run has an application of its own, set up beforehand."""
        line = Line(problem, intervals)
        line.setup(["--disable-output", "--quiet", "--no-openmp", "--cache-nnps"])

        def run():
            line.solver.solve(show_progress=False)
            return line.kept

        return run

    return Model(prepare, np.asarray, problem.scene.step_count)
