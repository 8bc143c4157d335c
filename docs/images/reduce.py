"""Make the pictures of the documents anew from the figures of full runs, benchmarks and surveys."""

import sys
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
WIDTH = 720  # pixels: a column of print, twice as large
MOVING = "figures/ten_harmonics/uniform100/k12.gif"


def source(picture: Path) -> str:
    """The figure that a picture is made of: of a survey, survey_{survey}_{drawing}.png."""
    if not picture.stem.startswith("survey_"):
        return f"figures/{picture.name}"
    survey, drawing = picture.stem.removeprefix("survey_").rsplit("_", 1)
    return f"studied/results/surveys/{survey}/{drawing}.png"


if __name__ == "__main__":
    pictures = sorted(HERE.glob("*.png"))
    sources = [source(path) for path in pictures]
    missing = [name for name in (*sources, MOVING) if not (ROOT / name).exists()]
    if missing:
        sys.exit(
            f"pictures: missing are {', '.join(missing)}; they are made by: make figures, then "
            f"snakemake --cores 2 benchmarks stability {MOVING}, and "
            "snakemake --cores 2 surveys --configfile config/surveys.yaml"
        )
    for path, source in zip(pictures, sources, strict=True):
        with Image.open(ROOT / source) as figure:
            size = (WIDTH, round(WIDTH * figure.height / figure.width))
            small = figure.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        # This method keeps the ends of a colour bar, of which a picture has few pixels.
        small.quantize(256, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)
    (HERE / "motion.gif").write_bytes((ROOT / MOVING).read_bytes())
