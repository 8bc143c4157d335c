"""Named, self-describing NetCDF files: the only module that writes data.

In memory a dataset is a plain ``dict`` of numpy arrays; `VARIABLES` says what each name
means. Files are written whole or not at all, the same arrays and attributes always give the same
bytes, and a file is only read if its bytes are those that were written.

Long, as a third of it is the table of what names mean.
"""

import errno
import json
import os
import re
import shutil
import sys
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib import metadata
from pathlib import Path
from textwrap import dedent
from typing import TYPE_CHECKING, Any, BinaryIO, NamedTuple
from uuid import uuid4

import numpy as np

from sphpod import __version__

# Files are written whole, and renamed: no lock is needed, and some file systems have none.
os.environ.setdefault("HDF5_USE_FILE_LOCKING", "FALSE")

import netCDF4

if TYPE_CHECKING:
    import pandas

PAPER = (
    "L. Fang, Z. Song, K. Fraser, H. Huang: Proper Orthogonal Decomposition-based Model-Order "
    "Reduction for Smoothed Particle Hydrodynamics Simulation - Mass-Spring-Damper System"
)


LENGTH_DIGITS = 12
CHECKSUM_DIGITS = 10
CHUNK = 1 << 20
"""How a file ends, and how much of it is read at a time for its checksum: bytes."""

INDEX = "_index"
"""How a dimension ends that text of its name labels: text cannot be a coordinate variable of CF."""

PLACES = "scene", "sampling"
"""Scalar coordinates that say what a file is of, so that files of several can be put together."""

LEAST_FREE = 1_000_000
"""Bytes that a disk has left which is full when a file cannot be written."""

ENERGY_ROOT = "kg0.5 s-1"
"""Unit of the root of an energy on a unit of cross-section, J/m²."""


class Variable(NamedTuple):
    """What a name means: its dimensions, unit ("" for text), meaning and type on disk.

    `coordinates` names the auxiliary coordinates (CF section 5) that label a dimension.
    """

    dims: tuple[str, ...]
    units: str
    long_name: str
    dtype: type = np.float64
    coordinates: str = ""


ENTRY = re.compile(
    r"(?P<name>\w+) \((?P<dims>[\w, ]*)\)(?: \[(?P<units>[^]]*)\])?(?: (?P<integer>int\d+))?"
    r"(?: along (?P<coordinates>\w+))?: (?P<meaning>.+)"
)


def meanings(table: str) -> dict[str, Variable]:
    """Variables by name, as a table says what they mean, a line each.

    A line is ``name (dimensions) [unit] type along coordinates: meaning``, and goes on in lines
    that are further in. Text has no unit, numbers of different ones have []; the type is float64
    where none is given.

    Raises
    ------
    ValueError
        A line is not of this form, or a name has two.
    """
    found: dict[str, Variable] = {}
    for line in filter(None, re.sub(r"\n +", " ", dedent(table)).splitlines()):
        entry = ENTRY.fullmatch(line)
        if entry is None or entry["name"] in found:
            raise ValueError(f"{line!r} is no variable of its own")
        number = np.dtype(entry["integer"] or float).type
        found[entry["name"]] = Variable(
            tuple(re.findall(r"\w+", entry["dims"])),
            entry["units"] or "",
            entry["meaning"],
            str if entry["units"] is None else number,
            entry["coordinates"] or "",
        )
    return found


OF_MODES = """
{field}_mode_rounding ({field}_mode) [1]: norm of the change that rounding makes of a mode of the
    {meaning}
{field}_span_rounding ({field}_mode) [1]: sine of the angle by which rounding turns the span of
    first modes of the {meaning}
"""

OF_FIELD = """
{field} (t, x) [{units}]: {meaning} of the particles
{field}_time ({field}_snapshot) [s]: time of the {meaning} snapshots
{field}_snapshots ({field}_snapshot, x) [{units}] along {field}_time: {meaning} snapshots
{field}_twins ({field}_snapshot, x) [{units}] along {field}_time: {meaning} snapshots of a run that
    starts one unit in the last place beside
{field}_modes ({field}_mode, x) [1]: orthonormal {meaning} modes, largest entry positive
{field}_singular_values ({field}_mode) [{units}]: singular values of the {meaning} snapshots
{field}_coordinates (t, {field}_mode) [{units}]: reduced coordinates of the {meaning}
{field}_error (solution_index, reference_index) [1]: relative L2 error of the {meaning} of a
    solution against a reference
{field}_error_estimate () [1]: estimated relative L2 error of the {meaning}, from three grids,
    factor of safety included
{field}_observed_order () [1]: order by which the error of the {meaning} falls from grid to grid
{field}_mode_count () [1] int32: modes kept for {field} alone
{field}_error_sph (mode_count) [1]: relative L2 error of the {meaning} of the reduced model against
    full SPH
{field}_error_reference (mode_count) [1]: relative L2 error of the {meaning} of the reduced model
    against the reference
{field}_error_full (contender_index) [1]: relative L2 error of the {meaning} of a model against full
    SPH, NaN for other particles
{field}_error_exact (contender_index) [1]: relative L2 error of the {meaning} of a model against the
    exact solution, else centred differences
acceleration_{field}_error (contender_index, mode_count) [1]: relative L2 error of the {meaning} of
    a reduced model against full SPH
"""

OTHERS = """
t (t) [s]: time
x (x) [m]: position of the particles at rest
error_sample (t) [1] int8: 1 where the time belongs to the error integral
asymptotic () [1] int8: 1 where three grids allow an estimate of the error, 0 where it is NaN
solution (solution_index): solution whose error is given
reference (reference_index): solution that the error is taken against
mode_count (mode_count) [1] int32: modes kept for velocity and density
modes_resolved (mode_count) [1] int8: 1 where rounding turns the span of the modes by at most 0.01,
    0 where it turns it by more and the error of the model may change with the processor
breakdown_time (mode_count) [s]: time at which the reduced model broke down
scaled_velocity_modes (scaled_velocity_mode, x) [1]: orthonormal modes of the velocity times root of
    mass
scaled_strain_modes (scaled_strain_mode, x) [1]: orthonormal modes of the strain times root of
    stiffness
scaled_velocity_singular_values (scaled_velocity_mode) [kg0.5 s-1]: singular values of the scaled
    velocity snapshots
scaled_strain_singular_values (scaled_strain_mode) [kg0.5 s-1]: singular values of the scaled strain
    snapshots
translation () [1] int8: 1 where the first velocity mode is the rigid translation, else 0
scaled_velocity_coordinates (t, scaled_velocity_mode) [kg0.5 s-1]: reduced coordinates of the scaled
    velocity
scaled_strain_coordinates (t, scaled_strain_mode) [kg0.5 s-1]: reduced coordinates of the scaled
    strain
strain (t, x) [1]: strain of the particles
reduced_operator (reduced_rate, reduced_state) [s-1]: rates of the reduced coordinates, of velocity
    and then of the other field, at rest, by the coordinates, in their units
reduced_constant (reduced_rate) [s-1]: rates of the coordinates that do not depend on them
reduced_force (reduced_rate, force_term) [1]: rates of the coordinates by the courses of the force's
    terms in time
time_error_estimate () [1]: estimated error of the time steps, of the largest energy norm
velocity_output (reduced_state, x) [1]: velocity of the particles by the coordinates, in SI units
density_output (reduced_state, x) [1]: mass density of the particles by the coordinates
strain_output (reduced_state, x) [1]: strain of the particles by the coordinates, in SI units
velocity_error_lifted (mode_count) [1]: relative error of the velocity against the lifted full model
strain_error_lifted (mode_count) [1]: relative error of the strain against the lifted full model
energy_error_lifted (mode_count) [1]: largest energy norm of the error, of that of the lifted full
    model
energy_error_bound (mode_count) [1]: bound of the largest energy norm of the error, of the largest
    norm
residual_bound (mode_count) [1]: the same bound from the residual alone
difference_from_best (mode_count) [1]: largest energy norm of the difference from the model with all
    modes
bound_slack (mode_count) [1]: smallest difference of bound and error over time, of the largest norm
error_bound (t) [kg0.5 s-1]: bound of the energy norm of the error
tolerance () [1]: largest allowed difference from the best model
best_mode_count () [1] int32: velocity modes that the snapshots give
certified () [1] int8: 1 where the bound is within the tolerance, else 0
contender (contender_index): model compared
n_freeze (contender_index) [1] int64: steps for which coefficients stay frozen, 0 for none
contender_mode_count (contender_index) [1] int32: modes kept for velocity and density, 0 for a full
    model
contender_modes_resolved (contender_index) [1] int8: 1 of a full model, else as modes_resolved
integrator (contender_index): how a model is stepped
contender_particle_count (contender_index) [1] int32: particles of the model
contender_time_step (contender_index) [s]: time step; NaN where it is not a fixed one
contender_tolerance (contender_index) [1]: relative tolerance of an adaptive integrator, NaN of
    another
reconstruction_seconds (contender_index, repeat) [s]: CPU time of fields from reduced
    coordinates
offline_seconds (contender_index, offline) [s]: CPU time of snapshots, modes and projection
cpu_seconds (contender_index, repeat) [s]: CPU time of all time steps
memory_bytes (contender_index) [byte] int64: memory that a prepared time loop holds
skipped (skipped_index): what a scene may lack
skipping_model (skipped_index): model that is timed with and without it
skipping_seconds (skipped_index, repeat) [s]: CPU time without it
general_seconds (skipped_index, repeat) [s]: CPU time with it in vain, as zeros or general
    structure
step_seconds (contender_index, repeat) [s]: CPU time of one time step
"""

VARIABLES = meanings(
    "".join(
        [
            *(
                (OF_FIELD + OF_MODES).format(field=field, units=units, meaning=meaning)
                for field, units, meaning in (
                    ("velocity", "m s-1", "velocity"),
                    ("density", "kg m-3", "mass density"),
                )
            ),
            OF_MODES.format(field="scaled_velocity", meaning="velocity times root of mass"),
            OF_MODES.format(field="scaled_strain", meaning="strain times root of stiffness"),
            OTHERS,
        ]
    )
)


def write(
    path: str | os.PathLike[str],
    arrays: Mapping[str, np.ndarray],
    *,
    title: str,
    settings: Mapping[str, Any],
    code: str,
    job: Mapping[str, Any] | None = None,
    attributes: Mapping[str, float] | None = None,
    variables: Mapping[str, Variable] | None = None,
) -> None:
    """Write `arrays` to a NetCDF file, whole or not at all.

    Parameters
    ----------
    path
        The file; its folder is made where it is missing.
    arrays
        Arrays by name, shaped as `VARIABLES` or ``variables`` says; NaN is a value too.
    title
        What the file holds, in one line.
    settings
        The resolved settings it comes from: plain JSON types.
    code
        Digest of the code that computed it (`provenance.digest`).
    job
        What the job of the workflow that computed it was given (`job.start`).
    attributes
        More that is reported of the file as a whole: numbers by name.
    variables
        What names mean that `VARIABLES` does not have.

    Raises
    ------
    KeyError
        For a name that is in neither.
    ValueError
        For an array whose shape contradicts its dimensions, or a value that its type cannot hold.
    """
    sizes: dict[str, int] = {}
    known = VARIABLES | dict(variables or {})
    for name, values in arrays.items():
        if name not in known:
            raise KeyError(f"no variable is named {name!r}; allowed are {', '.join(known)}")
        dims = known[name].dims
        shape = np.shape(values)
        if len(shape) != len(dims) or any(
            sizes.setdefault(dim, size) != size for dim, size in zip(dims, shape, strict=True)
        ):
            raise ValueError(f"{name} of shape {shape} does not fit {dims} with sizes {sizes}")
        dtype = known[name].dtype
        if issubclass(dtype, np.integer):
            with np.errstate(invalid="ignore"):
                changed = np.asarray(values)[np.asarray(values).astype(dtype) != values]
            if changed.size:
                raise ValueError(f"{name} = {changed[0]} does not fit the type {dtype.__name__}")
    texts = {
        "Conventions": "CF-1.11",
        "title": title,
        "history": _history(job),
        "source": f"sphpod {__version__}, code {code}; {_environment()}",
        "references": PAPER,
        "settings": json.dumps(settings, sort_keys=True, allow_nan=False),
        **(attributes or {}),
    }
    places = {
        name: of if isinstance(of, str) else of["name"]
        for name, of in settings.items()
        if name in PLACES
    }
    with whole(path) as partial:
        with netCDF4.Dataset(partial, "w", format="NETCDF4") as file:
            file.set_fill_off()
            file.setncatts(texts)
            for dim, size in sizes.items():
                file.createDimension(dim, size)
            for name, values in arrays.items():
                _write_variable(file, name, known[name], values, _labels(known, arrays, places))
            for name, text in places.items():
                variable = file.createVariable(name, str)
                variable.long_name = f"{name} that this is of"
                variable[...] = text
        _seal(partial, job)


def _write_variable(
    file: netCDF4.Dataset,
    name: str,
    meaning: Variable,
    values: np.ndarray,
    labels: Mapping[str, tuple[str, ...]],
) -> None:
    # What is missing is NaN. No value is filled in before: that would write every byte twice.
    numbers: np.ndarray = np.asarray(values, object if meaning.dtype is str else meaning.dtype)
    missing = numbers.dtype.kind == "f" and bool(np.isnan(numbers).any())
    variable: netCDF4.Variable = file.createVariable(
        name, meaning.dtype, meaning.dims, fill_value=np.nan if missing else False
    )
    coordinates = [
        label
        for label, dims in labels.items()
        if set(dims) <= set(meaning.dims) and name not in (label, *meaning.dims)
    ]
    texts = {
        "units": meaning.units,
        "long_name": meaning.long_name,
        "coordinates": " ".join(filter(None, [meaning.coordinates, *coordinates])),
    }
    variable.setncatts({key: text for key, text in texts.items() if text})
    variable[...] = numbers


def _labels(
    known: Mapping[str, Variable], arrays: Mapping[str, Any], places: Mapping[str, str]
) -> dict[str, tuple[str, ...]]:
    """Dimensions of what labels others: text along a dimension of its own, and the place."""
    names = [name for name in arrays if known[name].dims == (f"{name}{INDEX}",)]
    return {name: known[name].dims for name in names} | dict.fromkeys(places, ())


def _history(job: Mapping[str, Any] | None) -> str:
    """The command that makes a file, without a date, so that the same bytes come again."""
    outputs = " ".join(f"results/{path}" for path in job["output"]) if job else ""
    return f"snakemake {outputs}" if job else f"sphpod {__version__}"


def read(path: str | os.PathLike[str], *names: str) -> dict[str, np.ndarray]:
    """Arrays of a file by name; all of them where no name is given.

    Raises
    ------
    KeyError
        For a name that the file does not hold.
    ValueError
        For a file that is not, byte by byte, what `write` has written.
    """
    with _opened(path) as file:
        held = [name for name in file.variables if name not in PLACES]
        if missing := [name for name in names if name not in held]:
            raise KeyError(f"{path} holds {', '.join(held)}, but not {missing[0]}")
        return {
            name: file[name][...].astype(str) if file[name].dtype is str else file[name][...]
            for name in names or held
        }


def read_samples(path: str | os.PathLike[str], *names: str) -> dict[str, np.ndarray]:
    """As `read`, but of the times only those of the error integral, without ``error_sample``.

    A full solution holds snapshot times too; in a file without ``error_sample`` all times count.
    """
    with _opened(path) as file:
        marked = "error_sample" in file.variables
    arrays = read(path, *names, *(["error_sample"] if marked and names else []))
    if not marked:
        return arrays
    samples = arrays.pop("error_sample").astype(bool)
    if samples.all():
        return arrays
    return {
        name: values[samples] if "t" in VARIABLES[name].dims else values
        for name, values in arrays.items()
    }


def settings(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The resolved settings that a file comes from."""
    with _opened(path) as file:
        return json.loads(file.getncattr("settings"))


def job(path: str | os.PathLike[str]) -> dict[str, Any] | None:
    """What the job that wrote a file was given; None where no job of the workflow wrote it.

    Nothing but the end of the file is read, and no checksum.

    Raises
    ------
    ValueError
        For a file that does not end as `write` ends it.
    """
    with open(path, "rb") as file:
        end = os.fstat(file.fileno()).st_size - LENGTH_DIGITS - CHECKSUM_DIGITS
        try:
            file.seek(max(0, end))
            length = int(file.read(LENGTH_DIGITS))
            file.seek(max(0, end - length))
            return json.loads(file.read(length))
        except ValueError as error:
            raise ValueError(foreign(path)) from error


def foreign(path: str | os.PathLike[str]) -> str:
    """The sentence on a file that something else than the workflow has put or changed there."""
    return f"{path}: is not what its rule wrote; delete it"


@contextmanager
def _opened(path: str | os.PathLike[str]) -> Iterator[netCDF4.Dataset]:
    stat = os.stat(path)
    # Before HDF5 sees the file: it may go round in a damaged one for ever.
    if not _is_whole(os.path.abspath(path), stat.st_mtime_ns, stat.st_size):
        raise ValueError(foreign(path))
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        yield file


def _seal(path: Path, job: Mapping[str, Any] | None) -> None:
    """End a file: what its job was given, as JSON, the length of that, and a checksum of it all.

    This is text that stands behind the data, where no reader of NetCDF looks.
    """
    end = f"\n{json.dumps(job, sort_keys=True)}\n".encode()
    with open(path, "r+b") as file:
        file.seek(0, os.SEEK_END)
        file.write(end + f"{len(end):0{LENGTH_DIGITS}d}".encode())
        size = file.tell()
        file.seek(0)
        file.write(_checksum(file, size))


@lru_cache
def _is_whole(path: str, mtime_ns: int, size: int) -> bool:
    """Whether every byte of a file is as it was written; looked up once for each state of it."""
    with open(path, "rb") as file:
        return _checksum(file, size - CHECKSUM_DIGITS) == file.read()


def _checksum(file: BinaryIO, size: int) -> bytes:
    """CRC-32 of the first bytes of a file, after which its position is behind them.

    It finds every change of up to four bytes in a row, in a fraction of the time of reading arrays.
    """
    checksum = 0
    for start in range(0, size, CHUNK):
        checksum = zlib.crc32(file.read(min(CHUNK, size - start)), checksum)
    return f" {checksum:08x}\n".encode()


@cache
def _environment() -> str:
    """Versions of what is used to compute and to write."""
    libraries = "numpy", "scipy", "numba", "llvmlite", "netCDF4"
    versions = (f"{library} {metadata.version(library)}" for library in libraries)
    return ", ".join((f"Python {sys.version.split()[0]}", *versions))


def place(path: str | os.PathLike[str]) -> tuple[str, ...]:
    """The scene that a file is of, or the scene and the sampling."""
    of = settings(path)
    return (of["scene"], of["sampling"]["name"]) if "sampling" in of else (of["scene"],)


def write_table(path: str | os.PathLike[str], table: "pandas.DataFrame") -> None:
    """Write a table, without its index, as comma-separated values; whole or not at all."""
    with whole(path) as partial:
        table.to_csv(partial, index=False, lineterminator="\n")


@contextmanager
def whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Name of a file to write, which becomes `path` once it is complete, and vanishes otherwise.

    The name is unique to its writer: a process that a killed run left behind may still be writing
    under its own. What such processes have not finished is removed.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    for stale in path.parent.glob(f".{path.stem}.*.partial{path.suffix}"):
        stale.unlink(missing_ok=True)
    partial = path.with_name(f".{path.stem}.{uuid4().hex}.partial{path.suffix}")
    try:
        yield partial
        partial.replace(path)
    except (OSError, RuntimeError) as error:
        # NetCDF reports a full disk as an error of HDF, or as a lack of permission.
        free = shutil.disk_usage(path.parent).free
        if getattr(error, "errno", None) == errno.ENOSPC or free < LEAST_FREE:
            raise OSError(f"{path}: the disk is full, with {free} bytes left") from error
        raise
    finally:
        partial.unlink(missing_ok=True)
