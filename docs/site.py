"""Pages of the site that are made of README, CONTRIBUTING, and the figures that have been built.

Links from the documents to files of the project lead to nothing in the site: they become text.
"""

import html
import re
from pathlib import Path

from mkdocs.structure.files import File

from sphpod.config.config import load

ROOT = Path(__file__).parents[1]
PAGES = {"index.md": "README.md", "contributing.md": "CONTRIBUTING.md"}


def on_files(files, config):
    for name, source in PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8")
        # What is beside README is above the documents.
        text = re.sub(r"\]\((?!https?:|#)(?:docs/)?", "](", text)
        files.append(File.generated(config, name, content=text))
    files.append(File.generated(config, "gallery.md", content=gallery()))
    for picture in sorted((ROOT / "figures").glob("*.png")):
        uri = f"figures/{picture.name}"
        files.append(File.generated(config, uri, abs_src_path=str(picture)))
    return files


def gallery():
    """All figures that have been built, with their captions, in the paper's order."""
    settings = load([ROOT / "config/config.yaml"])
    figures = [(figure, "2.1") for figure in settings["illustrations"]]
    for scene in settings["scenes"].values():
        figures += [(figure, scene["section"]) for figure in scene["figures"]]
    parts = [
        "# Gallery",
        "Figures of the paper, rebuilt from full SPH and its reduced models.",
        "![Motion of full SPH and of two reduced models](images/motion.gif)",
    ]
    shown = set()
    for figure, section in figures:
        name = figure["name"]
        if (ROOT / "figures" / f"{name}.png").exists():
            shown.add(name)
            number = name.partition("_")[0]
            caption = html.escape(" ".join(figure["caption"].split()))
            parts.append(f"## Figure {number}, section {section}")
            parts.append(f"![Figure {number}](figures/{name}.png)\n\n{caption}")
    others = sorted(
        path.stem for path in (ROOT / "figures").glob("*.png") if path.stem not in shown
    )
    if others:
        parts.append("## Run time and stability")
        parts += [f"![{name}](figures/{name}.png)\n\n{_words(name)}" for name in others]
    if not shown:
        parts.append("There are none yet: `make figures` builds them.")
    return "\n\n".join(parts) + "\n"


def _words(name):
    """Which study, and of which scene and sampling."""
    return name.replace("_", " ").capitalize()


def on_page_markdown(markdown, page, config, files):
    """Links to README and CONTRIBUTING lead to their pages, links to other files become text."""
    places = {source: page for page, source in PAGES.items()}
    known = {"", *(file.src_uri for file in files)}

    def checked(match):
        text, (target, *anchor) = match[1], match[2].split("#")
        target = places.get(target.removeprefix("../"), target)
        return f"[{text}]({'#'.join([target, *anchor])})" if target in known else text

    return re.sub(r"(?<!!)\[([^\]]+)\]\(((?!https?:)[^)\s]+)\)", checked, markdown)
