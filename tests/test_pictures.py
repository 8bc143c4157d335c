"""The pictures of the documents are made from figures that are there."""

import shutil
import subprocess
import sys
from pathlib import Path

REDUCE = Path(__file__).parents[1] / "docs/images/reduce.py"


def test_a_missing_figure_is_named_before_any_picture_is_touched(tmp_path: Path) -> None:
    images = tmp_path / "docs/images"
    images.mkdir(parents=True)
    shutil.copy(REDUCE, images)
    (images / "one.png").write_bytes(b"as it was")
    run = subprocess.run(
        [sys.executable, str(images / "reduce.py")], capture_output=True, text=True, check=False
    )
    assert run.returncode == 1
    assert "figures/one.png" in run.stderr
    assert "Traceback" not in run.stderr
    assert run.stderr.count("\n") == 1
    assert (images / "one.png").read_bytes() == b"as it was"
