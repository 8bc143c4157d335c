"""pyMOR: the worked survey of parameters, and symplectic bases at its nominal parameters.

Follows the pyMOR documentation's tutorials "Building a Reduced Basis" (pod with the product of a
norm, InstationaryRBReductor) and "Model order reduction for parametric problems" (operators that
are LincombOperators with parameter functionals), and the page of pymor.algorithms.symplectic. All
of the survey's parameters stand in factors of fixed matrices if the model is one of strain, or of
displacement: c is c0 (1 + contrast sin(2πx/L)).

Time steps are pyMOR's implicit midpoint rule, or, as this project's queries are exact in time too,
jumps from output to output by `Jumps`, a time stepper of its interface with SciPy's exponential.
"""

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from pymor.algorithms.pod import pod
from pymor.algorithms.projection import project
from pymor.algorithms.symplectic import psd_complex_svd, psd_cotangent_lift, psd_svd_like_decomp
from pymor.algorithms.timestepping import ImplicitMidpointTimeStepper, TimeStepper
from pymor.core.logger import set_log_levels
from pymor.models.basic import InstationaryModel
from pymor.operators.block import BlockOperator
from pymor.operators.constructions import IdentityOperator, LincombOperator
from pymor.operators.numpy import NumpyMatrixOperator
from pymor.parameters.functionals import (
    ExpressionParameterFunctional,
    ProjectionParameterFunctional,
)
from pymor.reductors.basic import InstationaryRBReductor
from pymor.vectorarrays.block import BlockVectorSpace
from pymor.vectorarrays.numpy import NumpyVectorSpace
from scipy.linalg import block_diag, expm
from scipy.sparse import block_array, csr_array, diags_array

from benchmarks.peers.survey import MODE_COUNTS, Method, Surveyed, Task
from sphpod.scene.scene import derivative_matrix

STEPS = 10_000
"""Of the implicit midpoint rule in T, with which it is more accurate than 40 modes are."""

STEPPED = (40,)
"""Mode counts that it is timed with."""

EXACT = "exact, one jump to each output"


class Jumps(TimeStepper):
    """From output to output by the exponential of the operator; without mass and force."""

    def solve(
        self, initial_time, end_time, initial_data, operator, rhs=None, mass=None, mu=None,
        num_values=None,
    ):  # fmt: skip
        """All outputs, one a column."""
        matrix = operator.assemble(mu).matrix
        jump = expm(matrix * ((initial_time - end_time) / (num_values - 1)))
        states = np.empty((matrix.shape[0], num_values))
        states[:, 0] = initial_data.to_numpy()[:, 0]
        for n in range(num_values - 1):
            states[:, n + 1] = jump @ states[:, n]
        return operator.source.make_array(states)

    def iterate(self, *arguments, **settings):
        """All that `solve` gives is made at once."""
        raise NotImplementedError


class Line:
    """The matrices of the survey's scene: of G, of the energy, and of what is asked.

    Parameters
    ----------
    task : Task
    """

    def __init__(self, task: Task) -> None:
        set_log_levels({"pymor": "ERROR"})
        self.task, operators = task, task.operators
        scene = operators.nominal
        self.scene, self.count = scene, scene.particle_count
        self.bases: dict[Any, Any] = {}
        self.gradient = derivative_matrix(scene).tocsr()
        self.mass = scene.volumes * scene.density0()
        # c = stiffness (1 + contrast sin(2πx/L)), whatever its factors are called.
        unit = {"stiffness": 1.0, "decay": 1.0}
        even = operators.modulus.at(unit | {"contrast": 0.0})
        self.moduli = even, operators.modulus.at(unit | {"contrast": 1.0}) - even
        self.springs = scene.volumes * scene.modulus()
        self.factors = [
            ProjectionParameterFunctional("stiffness"),
            ExpressionParameterFunctional("stiffness*contrast", {"stiffness": 1, "contrast": 1}),
        ]
        self.decay = ProjectionParameterFunctional("decay")

    def snapshots(self, name):
        """Fields of all training runs, one a column."""
        return np.concatenate([run[name] for run in self.task.runs]).T

    def displacements(self):
        """Of all training runs: what has this strain, and moves as velocity says where none is."""
        impulse = np.eye(1, self.count)[0]
        symbol = 1j * np.fft.rfft(self.scene.derivative(impulse)).imag
        still = np.abs(symbol) < 1e-9 * np.abs(symbol).max()
        found = []
        for run in self.task.runs:
            strain, velocity = (np.fft.rfft(run[name]) for name in ("strain", "velocity"))
            spectrum = strain / np.where(still, 1, symbol)
            decay = dict(zip(self.task.settings["parameters"], run["point"], strict=True))["decay"]
            moved = (velocity[0] - velocity) / decay if decay else velocity[0] * run["t"][:, None]
            found.append(np.fft.irfft(np.where(still, moved, spectrum), self.count))
        return np.concatenate(found).T

    def basis(self, name, fom, columns, count):
        """POD of snapshots, made once."""
        if name not in self.bases:
            snapshots = fom.solution_space.make_array(columns)
            self.bases[name] = pod(snapshots, product=fom.mass, modes=count)[0]
        return self.bases[name]

    def modes(self, lifted):
        """Of displacement and of velocity alike: by the cotangent lift of both, or of the former.

        The lift is of every second output, or its Gram matrix would take a minute.
        """
        if lifted not in self.bases:
            space, most = NumpyVectorSpace(self.count), max(MODE_COUNTS)
            displaced = space.make_array(self.displacements())
            if lifted:
                both = [displaced[::2], space.make_array(self.snapshots("velocity"))[::2]]
                states = BlockVectorSpace([space] * 2).make_array(both)
                self.bases[lifted] = psd_cotangent_lift(states, 2 * most).E.blocks[0]
            else:
                self.bases[lifted] = pod(displaced, modes=most)[0]
        return self.bases[lifted]

    def asked(self, velocity, strain):
        """Rows of the quantities of velocity and of strain at their sensors."""
        rows = []
        for question in self.task.questions.values():
            if "place" in question.asked:
                row = np.zeros(self.count)
                row[question.particles] = question.weights
                is_velocity = question.asked["field"] == "velocity"
                rows.append(np.concatenate([row @ velocity, 0 * row]) if is_velocity else
                            np.concatenate([0 * row, row @ strain]))  # fmt: skip
        return NumpyMatrixOperator(np.array(rows))

    def lincomb(self, *blocks):
        """Operator of blocks for the two parts of the modulus, with their factors."""
        parts = [block(modulus) for modulus in self.moduli for block in blocks]
        return LincombOperator(list(map(NumpyMatrixOperator, parts)), self.factors)

    def answered(self, rom, energy, values):
        """The survey's quantities from pyMOR's solution."""
        mu = rom.parameters.parse(dict(values))
        states = rom.solve(mu)
        sensed = iter(rom.output_functional.apply(states).to_numpy())
        answers = []
        for question in self.task.questions.values():
            asked = question.asked
            if asked["kind"] == "energy":
                last = states[question.output]
                answers.append(energy.apply2(last, last, mu).item() / 2)
                continue
            field = next(sensed)
            if asked["kind"] == "history":
                answers.append(field)
            elif asked["kind"] == "maximum":
                answers.append(np.abs(field).max())
            else:
                answers.append(question.times[np.argmax(np.abs(field) >= asked["level"])])
        return answers


def methods(task: Task) -> Iterator[Method]:
    """Galerkin projection of the parametric model, of strain and of displacement."""
    line = Line(task)
    midpoint = ImplicitMidpointTimeStepper(STEPS)
    stepped = f"implicit midpoint, Δt = {task.settings['duration'] / STEPS:g} s"
    strain = "velocity and strain, POD of each"
    yield Method("pymor", strain, EXACT, partial(_strain, line, Jumps(), False))
    yield Method("pymor", strain, stepped, partial(_strain, line, midpoint, False), STEPPED)
    joint = "velocity and strain, POD of both together"
    yield Method("pymor", joint, EXACT, partial(_strain, line, Jumps(), True))
    second = "displacement and velocity"
    yield Method(
        "pymor", f"{second}, cotangent lift", EXACT, partial(_displacement, line, Jumps(), True)
    )
    yield Method(
        "pymor", f"{second}, POD of displacements", EXACT,
        partial(_displacement, line, Jumps(), False),
    )  # fmt: skip


def _strain(line: Line, stepper, joint, count):
    """v' + d v - G (c e)/ρ0 = 0, e' - G v = 0, times V ρ0 and V c at the nominal parameters."""
    most = max(MODE_COUNTS)
    count_all, product = line.count, np.concatenate([line.mass, line.springs])
    none = csr_array((count_all, count_all))
    volumes = diags_array(line.scene.volumes)
    stretch = -diags_array(line.springs) @ line.gradient
    static = block_array([[none, none], [stretch, none]]).tocsr()
    slow = block_array([[diags_array(line.mass), none], [none, none]]).tocsr()
    pulls = line.lincomb(
        lambda modulus: block_array(
            [[none, -volumes @ line.gradient @ diags_array(modulus)], [none, none]]
        ).tocsr()
    )
    energy = line.lincomb(
        lambda modulus: block_array([[none, none], [none, volumes @ diags_array(modulus)]]).tocsr()
    ) + NumpyMatrixOperator(slow)
    operator = LincombOperator(
        [NumpyMatrixOperator(static), NumpyMatrixOperator(slow), *pulls.operators],
        [1.0, line.decay, *pulls.coefficients],
    )
    unit = np.eye(count_all)
    fom = _model(line, operator, product, line.asked(unit, unit), line.scene.velocity0(), stepper)
    fields = line.snapshots("velocity"), line.snapshots("strain")
    if joint:
        basis = line.basis("joint", fom, np.concatenate(fields), 2 * most)[: 2 * count]
    else:
        basis = fom.solution_space.empty()
        for n, rows in enumerate(fields):
            part = np.zeros((2 * count_all, rows.shape[1]))
            part[n * count_all : (n + 1) * count_all] = rows
            basis.append(line.basis(f"field {n}", fom, part, most)[:count])
    return _surveyed(line, fom, basis, energy, lambda states: np.split(states, 2))


def _displacement(line: Line, stepper, lifted, count):
    """u' - v = 0, v' + d v - G (c G u)/ρ0 = 0, times V ρ0, in one basis of both."""
    none, masses = csr_array((line.count,) * 2), diags_array(line.mass)
    pulls = line.lincomb(lambda modulus: _block(none, _springs(line, modulus), 1, 0))
    static = block_array([[none, -masses], [none, none]]).tocsr()
    slow = block_array([[none, none], [none, masses]]).tocsr()
    operator = LincombOperator(
        [NumpyMatrixOperator(static), NumpyMatrixOperator(slow), *pulls.operators],
        [1.0, line.decay, *pulls.coefficients],
    )
    energy = line.lincomb(
        lambda modulus: _block(none, _springs(line, modulus), 0, 0)
    ) + NumpyMatrixOperator(slow)
    product = np.concatenate([line.mass, line.mass])
    unit, gradient = np.eye(line.count), line.gradient.toarray()
    asked = line.asked(unit, gradient).matrix
    asked = NumpyMatrixOperator(np.roll(asked, line.count, axis=1))
    fom = _model(line, operator, product, asked, line.scene.velocity0(), stepper, second=True)
    one = line.modes(lifted)[:count].to_numpy()
    # Masses are alike, so that what is orthonormal is so in their product too.
    columns = block_diag(one, one) / np.sqrt(line.mass[0])
    basis = fom.solution_space.make_array(columns)

    def shown(states):
        displacement, velocity = np.split(states, 2)
        return velocity, line.gradient @ displacement

    return _surveyed(line, fom, basis, energy, shown)


def _springs(line, modulus):
    return -diags_array(line.scene.volumes) @ line.gradient @ diags_array(modulus) @ line.gradient


def _block(none, block, row, column):
    """Two by two blocks, of which one is not zero."""
    blocks = [[none, none], [none, none]]
    blocks[row][column] = block
    return block_array(blocks).tocsr()


def _model(line, operator, product, asked, velocity, stepper, second=False):
    start = np.zeros(2 * line.count)
    start[second * line.count :][: line.count] = velocity
    return InstationaryModel(
        T=line.scene.duration,
        initial_data=operator.source.make_array(start[:, None]),
        operator=operator,
        rhs=None,
        mass=NumpyMatrixOperator(diags_array(product).tocsr()),
        time_stepper=stepper,
        num_values=line.scene.error_times.size,
        output_functional=asked,
    )


def _surveyed(line, fom, basis, energy, shown):
    reductor = InstationaryRBReductor(fom, basis, product=fom.mass, product_is_mass=True)
    rom = reductor.reduce()
    small = project(energy, basis, basis)

    def fields(values):
        states = rom.solve(rom.parameters.parse(dict(values)))
        velocity, strain = shown(reductor.reconstruct(states).to_numpy())
        return velocity.T, strain.T

    def growth(values):
        matrix = rom.operator.assemble(rom.parameters.parse(dict(values))).matrix
        return float(np.linalg.eigvals(-matrix).real.max())

    return Surveyed(fields, partial(line.answered, rom, small), growth)


# --- Symplectic bases at the nominal parameters ---------------------------------------------------


def symplectic(task: Task, counts: Sequence[int]) -> Iterator[Method]:
    """PSD bases of the run at the nominal parameters; the damping is projected with the rest."""
    line = Line(task)
    for name, bases in (
        ("cotangent lift", psd_cotangent_lift),
        ("complex SVD", psd_complex_svd),
        ("SVD-like decomposition", psd_svd_like_decomp),
    ):
        build = partial(_symplectic, line, bases)
        yield Method("pymor", f"symplectic, {name}", EXACT, build, counts)


def _symplectic(line: Line, bases, count):
    """x' = A x with x = (u, v), projected as Eᵀ₊ A E with the symplectic inverse of the basis."""
    values = line.task.tested[0]
    modulus = values["stiffness"] * (line.moduli[0] + values["contrast"] * line.moduli[1])
    pull = -diags_array(1 / line.mass) @ _springs(line, modulus)
    space = NumpyVectorSpace(line.count)
    identity = IdentityOperator(space)
    operator = BlockOperator(
        [[None, identity], [NumpyMatrixOperator(pull.tocsr()), identity * -values["decay"]]]
    )
    columns = line.displacements(), line.snapshots("velocity")
    states = operator.source.make_array([space.make_array(rows) for rows in columns])
    basis = bases(states, 2 * count)
    ansatz = basis.to_array()
    test = basis.transposed_symplectic_inverse().to_array()
    start = operator.source.make_array(
        [space.zeros(), space.make_array(line.scene.velocity0()[:, None])]
    )
    reduced = project(operator, test, ansatz)
    asked = line.asked(np.eye(line.count), line.gradient.toarray()).matrix
    columns = np.concatenate([part.to_numpy() for part in ansatz.blocks])
    rom = InstationaryModel(
        T=line.scene.duration,
        initial_data=reduced.source.make_array(test.inner(start)),
        operator=NumpyMatrixOperator(-reduced.matrix),
        rhs=None,
        time_stepper=Jumps(),
        num_values=line.scene.error_times.size,
        output_functional=NumpyMatrixOperator(np.roll(asked, line.count, axis=1) @ columns),
    )
    displaced, moving = np.split(columns, 2)
    strained = line.gradient @ displaced
    springs = (line.scene.volumes * modulus)[:, None]
    energy = NumpyMatrixOperator(
        strained.T @ (springs * strained) + moving.T @ (line.mass[:, None] * moving)
    )

    def fields(values):
        states = rom.solve().to_numpy()
        return (moving @ states).T, (strained @ states).T

    return Surveyed(fields, lambda values: line.answered(rom, energy, {}))
