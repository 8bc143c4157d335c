"""Make the pictures of the documents anew from the figures of a full run and of the benchmarks."""

import sys
from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
WIDTH = 720  # pixels: a column of print, twice as large
MOVING = "figures/ten_harmonics/uniform100/k12.gif"

if __name__ == "__main__":
    pictures = sorted(HERE.glob("*.png"))
    sources = [f"figures/{path.name}" for path in pictures]
    missing = [name for name in (*sources, MOVING) if not (ROOT / name).exists()]
    if missing:
        sys.exit(
            f"pictures: missing are {', '.join(missing)}; they are made by: make figures, then "
            f"snakemake --cores 2 benchmarks stability {MOVING}"
        )
    for path, source in zip(pictures, sources, strict=True):
        with Image.open(ROOT / source) as figure:
            size = (WIDTH, round(WIDTH * figure.height / figure.width))
            small = figure.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        # This method keeps the ends of a colour bar, of which a picture has few pixels.
        small.quantize(256, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)
    (HERE / "motion.gif").write_bytes((ROOT / MOVING).read_bytes())
