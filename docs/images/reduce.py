"""Make the pictures of the documents anew from the figures of a full run and of the benchmarks."""

from pathlib import Path

from PIL import Image

HERE = Path(__file__).parent
WIDTH = 1200  # pixels: sharp at twice the width that a page shows

if __name__ == "__main__":
    for path in sorted(HERE.glob("*.png")):
        with Image.open(HERE.parents[1] / "figures" / path.name) as figure:
            size = (WIDTH, round(WIDTH * figure.height / figure.width))
            small = figure.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        # This method keeps the ends of a colour bar, of which a picture has few pixels.
        small.quantize(256, Image.Quantize.MAXCOVERAGE).save(path, optimize=True)
    # Of the target figures/ten_harmonics/uniform100/k12.gif.
    moving = HERE.parents[1] / "figures/ten_harmonics/uniform100/k12.gif"
    (HERE / "motion.gif").write_bytes(moving.read_bytes())
