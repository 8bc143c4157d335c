"""What the paper claims, and whether the results bear it out.

A claim of the configuration names the criterion that decides on it (`sphpod.paper.criteria`), with
its thresholds. Claims are checked and given the paths of what they look at before any job starts.
"""

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from inspect import signature
from typing import Any

from sphpod.config.mode_counts import parse_modes
from sphpod.config.reading import ConfigError
from sphpod.numerics.error import FIELDS, Arrays
from sphpod.paper import statements  # noqa: F401  (registers its criteria)
from sphpod.paper.criteria import CRITERIA, FILES
from sphpod.studies.comparison import near_rounding
from sphpod.studies.variants import OWN

COLUMNS = (
    "id", "section", "scene", "sampling", "claim", "criterion", "paper", "reproduced",
    "relative_difference", "tolerance", "verdict", "near_rounding",
)  # fmt: skip

PLACE_KEYS = ("samplings", "studies", "places")
"""Where a criterion looks, if not at the scene and sampling of its claim."""


def resolve(config: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Claims with, for each of their criteria, the files of every place it looks at.

    Parameters
    ----------
    config : resolved configuration

    Returns
    -------
    list of dict
        Each claim of the configuration with ``criterion`` as a list, and ``files`` in each of its
        entries: of each place, paths below the results by the names in `FILES`. All of plain JSON
        types.

    Raises
    ------
    ConfigError
        Two claims have one id, or a claim asks for what the configuration does not hold.
    """
    resolved: list[dict[str, Any]] = []
    for claim in config["claims"]:
        if any(claim["id"] == other["id"] for other in resolved):
            raise _refusal(claim, "id", claim["id"], "this id stands twice; once is allowed")
        given = claim["criterion"]
        criteria = []
        for one in given if isinstance(given, list) else [given]:
            _check_keys(claim, one)
            _check_paper(claim, one)
            _check_places(claim, one)
            looked_at = [_files(config, claim, one, *place) for place in _places(claim, one)]
            criteria.append({**one, "files": looked_at})
        resolved.append({**claim, "criterion": criteria})
    return resolved


def inputs(claims: Sequence[Mapping[str, Any]]) -> list[str]:
    """Paths below the results that resolved claims look at, each once."""
    paths = (
        path
        for claim in claims
        for one in claim["criterion"]
        for place in one["files"]
        for path in place.values()
    )
    return list(dict.fromkeys(paths))


def _refusal(claim, key, value, allowed) -> ConfigError:
    return ConfigError(f"claim {claim['id']}: {key} = {value}: {allowed}")


def _check_keys(claim, one) -> None:
    """Refuse a threshold that the criterion lacks, or that it does not know."""
    kind = CRITERIA[one["kind"]]
    needed = [
        p.name for p in signature(kind.decide).parameters.values() if p.kind is p.KEYWORD_ONLY
    ]
    allowed = ["kind", *needed, *([*PLACE_KEYS] if kind.files else [])]
    for key in one:
        if key not in allowed:
            known = f"{one['kind']} has no such key; allowed are {', '.join(allowed)}"
            raise _refusal(claim, f"criterion.{key}", one[key], known)
    for key in needed:
        if key not in one:
            raise _refusal(claim, f"criterion.{key}", "(missing)", f"{one['kind']} needs it")


def _check_places(claim, one) -> None:
    """Refuse fewer places than the criterion compares, or more than it can."""
    kind = CRITERIA[one["kind"]]
    number = len(list(_places(claim, one)))
    if kind.files and not kind.least <= number <= kind.most:
        needed = str(kind.least) if kind.least == kind.most else f"{kind.least} or more"
        if kind.least < kind.most < math.inf:
            needed = f"{kind.least} to {kind.most}"
        key = next((key for key in PLACE_KEYS if key in one), "places")
        allowed = f"{one['kind']} looks at {needed} of them, not {number}"
        raise _refusal(claim, f"criterion.{key}", one.get(key, "(missing)"), allowed)


def _check_paper(claim, one) -> None:
    """Refuse what cannot be compared with what the criterion finds."""
    value, wanted = claim["paper"], CRITERIA[one["kind"]].paper
    if wanted == "a matrix":
        size = one["harmonics"]
        rows = value if isinstance(value, list) else []
        fits = len(rows) == size and all(isinstance(r, list) and len(r) == size for r in rows)
        fits = fits and all(isinstance(entry, int | float) for row in rows for entry in row)
        wanted = f"{wanted} of {size} by {size} numbers"
    elif wanted == "a number":
        fits = isinstance(value, int | float) and value != 0
        wanted = f"{wanted} other than 0"
    elif wanted == "a percentage":
        fits = isinstance(value, str) and re.fullmatch(r"[1-9]\d*%", value) is not None
    else:
        fits = value == wanted
    if not fits:
        raise _refusal(claim, "paper", value, f"for {one['kind']} it must be {wanted}")


def _places(claim, one) -> Iterator[tuple[str | None, str | None]]:
    """Scenes and samplings that a criterion looks at: the claim's, unless it names its own."""
    if not CRITERIA[one["kind"]].files:
        return
    if "studies" in one:
        yield from one["studies"].items()
    elif "places" in one:
        for place in one["places"]:
            scene, _, sampling = place.partition("/")
            yield scene, sampling or None
    else:
        for sampling in one.get("samplings", [claim.get("sampling")]):
            yield claim.get("scene"), sampling


def _files(config, claim, one, scene, sampling) -> dict[str, str]:
    """Paths of what a criterion looks at in one place, once it is sure that they can be made."""

    def demand(key, value, known, what):
        if value not in known:
            there = ", ".join(map(str, known)) or "none"
            allowed = f"there is no such {what}; allowed are {there}"
            raise _refusal(claim, key, "(missing)" if value is None else value, allowed)

    files = CRITERIA[one["kind"]].files
    demand("scene", scene, list(config["scenes"]), "scene")
    settings = config["scenes"][scene]
    where, mode_counts = f"of scene {scene}", ""
    needed = [name for name in ("exact", "modified") if name in files]
    for reference in [*needed, one.get("reference")]:
        if reference is not None:
            demand("reference", reference, settings["references"], f"reference {where}")
    if "variants" in files:
        runs = config["studies"]["variants"]["runs"]
        demand("scene", scene, list(runs), "scene with variants")
        for variant in one.get("variants", []):
            known = [OWN, *(name for of_scene in runs.values() for name in of_scene)]
            demand("criterion.variants", variant, known, "variant")
    if set(files) - {"errors", "exact", "modified", "sph", "variants"}:
        demand("sampling", sampling, list(settings["samplings"]), f"sampling {where}")
        mode_counts = settings["samplings"][sampling]["mode_counts"]
    available = parse_modes(mode_counts) if "sweep" in files else []
    if {"acceleration", "cpu_time"} & set(files):
        demand("sampling", sampling, list(settings["acceleration"]), f"acceleration study {where}")
        study = settings["acceleration"][sampling]
        available = study["mode_counts"]
        methods = ["original", "linearized", *(f"frozen{n}" for n in study["n_freeze"])]
        for method in one.get("methods", [one["method"]] if "method" in one else []):
            demand("method", method, methods, f"method in study {sampling} {where}")
    for key in ("mode_counts", "after", "begin") if available else ():
        for count in one.get(key, []) if key == "mode_counts" else [one.get(key, available[0])]:
            demand(key, count, available, f"mode count of {sampling} {where}")
    if "pod" in files:
        _check_mode_number(claim, one, settings, sampling)
    return {
        name: FILES[name].format(scene=scene, sampling=sampling, mode_counts=mode_counts)
        for name in files
    }


def _check_mode_number(claim, one, settings, sampling) -> None:
    """Refuse a criterion on more modes of a field than its snapshots give."""
    times = settings["samplings"][sampling]
    fields = [one["field"]] if "field" in one else FIELDS
    if "counts" in times:
        counts = [times["counts"][FIELDS.index(field)] for field in fields]
    elif "count" in times:
        counts = [times["count"]]
    else:
        counts = [len(times[f"{field}_times"]) for field in fields]
    there = min(*counts, settings["particle_count"])
    needed = {
        "harmonics": one.get("harmonics", 0),
        "modes": one.get("modes", 0),
        "among": one.get("among", 0) + 1,
        "after": one.get("after", 0) + 1,
        "groups": one.get("groups", 0) * one.get("size", 0) + 1,
    }
    for key, number in needed.items():
        if number > there:
            allowed = f"it needs {number} modes, and sampling {sampling} gives {there}"
            raise _refusal(claim, key, one[key], allowed)


def statement(claim: Mapping[str, Any]) -> str:
    """The criteria of a resolved claim in words, with their thresholds."""

    def shown(value):
        if isinstance(value, list):
            return " and ".join(map(shown, value))
        return f"{value:g}" if isinstance(value, float) else str(value)

    def worded(one):
        values = {"tolerance": 0, **claim, **one}
        text = CRITERIA[one["kind"]].text.format(**{k: shown(v) for k, v in values.items()})
        names = one.get("samplings") or one.get("places")
        names = names or [" ".join(pair) for pair in one.get("studies", {}).items()]
        return f"{text} ({', '.join(names)})" if names else text

    return "; ".join(map(worded, claim["criterion"]))


def table(
    claims: Sequence[Mapping[str, Any]], read: Callable[[str], Arrays]
) -> list[dict[str, Any]]:
    """Decide on resolved claims.

    Parameters
    ----------
    claims : list of dict
        From `resolve`.
    read : callable
        Gives the arrays of a dataset by its path below the results.

    Returns
    -------
    list of dict
        One row a claim, with the keys of `COLUMNS`; None where a row has no such value. The last
        reports which mode counts that were looked at use modes near rounding (`pod.resolved`).
    """
    rows = []
    for claim in claims:
        findings = []
        unresolved: dict[str, None] = {}
        for one in claim["criterion"]:
            places = [{name: read(path) for name, path in p.items()} for p in one["files"]]
            other = ("kind", "files", *PLACE_KEYS)
            thresholds = {key: value for key, value in one.items() if key not in other}
            findings.append(CRITERIA[one["kind"]].decide(places, claim, **thresholds))
            models = (data for place in places for data in place.values())
            near = [near_rounding(data) for data in models if "modes_resolved" in data]
            unresolved |= dict.fromkeys(text for text in near if text)
        holds = all(bool(finding.holds) for finding in findings)
        reproduced = _cell(findings[0].measured)
        if claim["paper"] == "yes":
            measured = "; ".join(finding.measured for finding in findings)
            reproduced = f"{'yes' if holds else 'no'}: {measured}"
        difference = findings[0].difference
        rows.append(
            {
                **{key: claim.get(key, "") for key in ("id", "section", "scene", "sampling")},
                "claim": claim["claim"],
                "criterion": statement(claim),
                "paper": _cell(claim["paper"]),
                "reproduced": reproduced,
                "relative_difference": None if math.isnan(difference) else difference,
                "tolerance": claim.get("tolerance"),
                "verdict": _verdict(claim, holds),
                "near_rounding": "; ".join(unresolved),
            }
        )
    return rows


def _verdict(claim: Mapping[str, Any], holds: bool) -> str:
    """In a word; what is reproduced by another convention than the paper's names its erratum."""
    erratum = f" with erratum {claim['erratum']}" if "erratum" in claim else ""
    return f"reproduced{erratum}" if holds else "deviates"


def _cell(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, list) else value


def markdown(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table of claims for reading: numbers to the paper's digits, deviations in bold."""

    def shown(value):
        text = f"{value:.4g}" if isinstance(value, float) else str(value)
        return text.replace("|", "\\|")

    lines = ["| | Claim | Criterion | Paper | Reproduced | Verdict |", "|---|---|---|---|---|---|"]
    for row in rows:
        where = ", ".join(row[key] for key in ("scene", "sampling") if row[key])
        claim = f"{row['claim']} ({where})" if where else row["claim"]
        verdict = row["verdict"]
        verdict = f"**{verdict}**" if verdict == "deviates" else verdict
        cells = (row["id"], claim, row["criterion"], row["paper"], row["reproduced"], verdict)
        lines.append(f"| {' | '.join(map(shown, cells))} |")
    return "\n".join(lines) + "\n"
