"""What is said of a target that nothing makes: what is made in its place, and near names."""

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import PurePath

Names = Callable[[str, Mapping[str, str]], Iterable[str] | None]
"""Names that a wildcard may stand for beside those of earlier ones; None if they are not listed."""

WILDCARD = re.compile(r"\{(\w+)\}")


def unlike(patterns: Iterable[str]) -> str:
    """Regular expression that matches nothing itself, where none of these matches up to the end."""
    nameless = (re.sub(r"\(\?P<\w+>", "(?:", one).removesuffix("$") for one in patterns)
    return f"(?!(?:{'|'.join(nameless)})$)"


def choice(what: str, name: str, names: Iterable[str], near: str = "") -> str:
    """Sentence about a name that is none of those there are, with a near one."""
    names = list(names)
    near = near or next(iter(difflib.get_close_matches(name, names, n=1)), "")
    meant = f"did you mean {near}? " if near else ""
    allowed = f"allowed are {', '.join(names)}" if names else "there is none"
    return f"{what} = {name}: {meant}{allowed}"


def refusal(target: str, made: Sequence[str], root: str, words: Sequence[str], names: Names) -> str:
    """Sentence about a target that nothing makes.

    Parameters
    ----------
    target : str
        A path, or a bare word.
    made : list
        Paths that are made below the root, such as "results/{scene}/sph.nc".
    root : str
        Folder of what is made, "." for that of the run.
    words : list
        Targets without a file.
    names : callable
    """
    path, output = PurePath(target), PurePath(root)
    tops = list(dict.fromkeys(one.partition("/")[0] for one in made))
    within = path.relative_to(output).parts if path.is_relative_to(output) else ()
    if within and within[0] in tops:
        return _within(PurePath(*within), made, output, names)
    elsewhere = next((str(output / one) for one in _homes(path.name, made, {})), "")
    if len(path.parts) == 1:
        return choice("target", target, words, elsewhere)
    every = [str(output / file) for one in made for file in _expanded(one, names, {})]
    near = next(iter(difflib.get_close_matches(target, every, n=1)), elsewhere)
    meant = f"did you mean {near}? " if near else ""
    places = " and ".join(str(output / top) for top in tops)
    return f"target = {target}: {meant}files are made in {places} alone"


def _within(path, made, output, names) -> str:
    """About a path in a folder of what is made, whose first part that does not exist is named."""
    place: dict[str, str] = {}
    if path.parts[0] == "figures" and path.suffix != ".gif":
        return _figure(path, made, output)
    rest = [PurePath(one).parts for one in made]
    for depth, part in enumerate(path.parts):
        below = str(PurePath(*path.parts[:depth]))
        files = [one[depth] for one in rest if len(one) == depth + 1]
        rest = [one for one in rest if len(one) > depth + 1]
        folders = list(dict.fromkeys(one[depth] for one in rest))
        free = [found[1] for one in folders if (found := WILDCARD.fullmatch(one))]
        known: dict[str, str] = {}
        for wildcard in free:
            listed = names(wildcard, place)
            any_goes = [part] if depth < len(path.parts) - 1 else []
            known |= dict.fromkeys(any_goes if listed is None else listed, wildcard)
        homes = _homes(path.name, made, place)
        if part in folders:
            rest = [one for one in rest if one[depth] == part]
        elif part in known:
            place[known[part]] = part
            rest = [one for one in rest if one[depth] == f"{{{known[part]}}}"]
        elif depth < len(path.parts) - 1:
            of = f"scene {place['scene']}: " if "scene" in place and free else ""
            near = next((str(output / one) for one in homes if not free and "{" not in one), "")
            literal = [one for one in folders if not WILDCARD.fullmatch(one)]
            what = free[0] if free else f"{below}: folder"
            return choice(f"{of}{what}", part, [*known, *literal], near)
        else:
            break
    else:
        held = [one[depth + 1] for one in rest if len(one) == depth + 2]
        held = held or list(dict.fromkeys(one[depth + 1] for one in rest))
        return f"file = {path}: this is a folder, for {', '.join(held)}"
    for home in homes:
        if "{" in home:
            return f"file = {path}: there is one in each {PurePath(home).parent}"
    near = next((str(output / home) for home in homes), "")
    return choice(f"{below}: file", part, sorted(files), near)


def _figure(path, made, output) -> str:
    """About a figure: these lie beside one another, in two forms."""
    figures = [PurePath(one) for one in made if one.startswith("figures/")]
    form = path.suffix if path.suffix in {one.suffix for one in figures} else ".pdf"
    names = [one.name for one in figures if one.suffix == form]
    near = path.name if path.name in names else ""
    return choice("figure", str(path.relative_to("figures")), names, near)


def _homes(name, made, place) -> list[str]:
    """Where files of a name are made, with what is known of the place."""
    paths = [one for one in made if PurePath(one).name == name]
    return [WILDCARD.sub(lambda w: place.get(w[1], w[0]), one) for one in paths]


def _expanded(pattern, names, place) -> Iterator[str]:
    """Paths of a pattern, in which wildcards stay whose names are not listed."""
    for wildcard in WILDCARD.finditer(pattern):
        if wildcard[1] not in place and (known := names(wildcard[1], place)) is not None:
            for name in known:
                yield from _expanded(
                    pattern.replace(wildcard[0], name), names, place | {wildcard[1]: name}
                )
            return
    yield pattern
