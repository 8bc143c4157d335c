"""A folder to deposit: results, figures, report, configuration, code and environments, an RO-Crate.

`make deposit` runs it in an environment of its own: python -m sphpod.pipeline.deposit FOLDER.
"""

import hashlib
import json
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

CODE = ("Snakefile", "workflow", "sphpod", "profiles", "config", "pyproject.toml", "Makefile")
TEXTS = ("README.md", "CHANGELOG.md", "CITATION.cff", "LICENSE")
LEFT_OUT = ("logs", "__pycache__", ".gitignore")
FORMATS = {
    ".nc": "application/x-netcdf",
    ".csv": "text/csv",
    ".html": "text/html",
    ".md": "text/markdown",
    ".pdf": "application/pdf",
    ".png": "image/png",
    ".gif": "image/gif",
    ".py": "text/x-python",
    ".yaml": "application/yaml",
}
CHECKSUMS = "manifest-sha256.txt"


def deposit(root: Path, folder: Path) -> None:
    """Copy what a run has made, and what made it, with checksums and RO-Crate metadata.

    Parameters
    ----------
    root : path
        Of the project, in which results, figures and report.html have been made.
    folder : path
        To be made; it must not be there.

    Raises
    ------
    ValueError
        The folder is there, or something that is to be deposited is not.
    """
    if folder.exists():
        raise ValueError(f"{folder}: it is there already; a deposit is made once")
    environments = [path.name for path in sorted(root.glob("environment*.txt"))]
    names = ["results", "figures", "report.html", *CODE, *TEXTS, *environments]
    for name in names:
        if not (root / name).exists():
            raise ValueError(f"{name}: there is none; a deposit is made of a finished run")
    for name in names:
        source, copy = root / name, folder / name
        if source.is_dir():
            shutil.copytree(source, copy, ignore=shutil.ignore_patterns(*LEFT_OUT))
        else:
            copy.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, copy)
    _describe(root, folder)
    lines = [f"{_checksum(path)}  {path.relative_to(folder)}\n" for path in _files([folder])]
    (folder / CHECKSUMS).write_text("".join(lines), encoding="utf-8")


def _describe(root: Path, folder: Path) -> None:
    """Write ro-crate-metadata.json: the folder, each file of it, the paper and the software."""
    from rocrate.model import ContextEntity  # type: ignore[import-not-found]
    from rocrate.rocrate import ROCrate  # type: ignore[import-not-found]

    crate = ROCrate(version="1.1")
    crate.name = "Results of sphpod"
    crate.description = (
        "Data, figures, tables and report of a run of sphpod: reduced models of Lagrangian SPH by "
        "proper orthogonal decomposition, with the configuration, code and environments that made "
        "them."
    )
    crate.license = "https://spdx.org/licenses/MIT"
    crate.root_dataset["datePublished"] = _date(root)
    paper = {
        "@type": "ScholarlyArticle",
        "name": "Proper Orthogonal Decomposition-based Model-Order Reduction for Smoothed Particle "
        "Hydrodynamics Simulation - Mass-Spring-Damper System",
    }
    article = crate.add(ContextEntity(crate, "https://arxiv.org/abs/2508.00335", properties=paper))
    crate.root_dataset["citation"] = article
    for path in _files([folder]):
        name = path.relative_to(folder).as_posix()
        properties: dict[str, Any] = {"contentSize": str(path.stat().st_size)}
        if path.suffix in FORMATS:
            properties["encodingFormat"] = FORMATS[path.suffix]
        crate.add_file(path, name, properties=properties)
    metadata = crate.metadata.generate()
    (folder / "ro-crate-metadata.json").write_text(
        json.dumps(metadata, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
    )


def _date(root: Path) -> str:
    """Day of the commit that the code is of."""
    command = ["git", "-C", str(root), "log", "-1", "--format=%cs"]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def _files(folders: Iterable[Path]) -> Iterator[Path]:
    for folder in folders:
        yield from sorted(path for path in folder.rglob("*") if path.is_file())


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


if __name__ == "__main__":
    try:
        deposit(Path.cwd(), Path(sys.argv[1]))
    except ValueError as error:
        sys.exit(f"sphpod: {error}")
