"""Pictures that move."""

import numpy as np
import pytest
from PIL import Image, ImageSequence
from scenes import scene

from sphpod.figures import animation
from sphpod.full import sph
from sphpod.reduced import certificate, lifted_rom, pod, rom, snapshots
from sphpod.reference import exact

SAMPLING = {"range": [0, 1], "count": 9}


@pytest.fixture(scope="module")
def solved():
    from sphpod.full import lifted

    case = scene()
    full = sph.solve(case, snapshots.output_steps(case, [SAMPLING]))
    taken = snapshots.extract(case, SAMPLING, full)
    full = sph.solve(case, case.error_steps)
    known = exact.solve(case)
    original = rom.sweep(case, "original", [4], pod.decompose(taken), full, known)
    strained = lifted.solve(case, "exact")
    linear = certificate.certify(case, [4], lifted_rom.decompose(case, taken), strained, known)
    return case, full, original, linear


@pytest.mark.slow
def test_velocities_of_both_models_are_near_those_of_full_sph(solved):
    _, full, *models = solved
    rows = np.array([0, 30, 100])
    size = np.abs(full["velocity"]).max()
    for reduced in models:
        found = animation.velocities(reduced, rows)
        np.testing.assert_allclose(found, full["velocity"][rows], atol=0.02 * size)


@pytest.mark.slow
def test_an_animation_has_its_frames_and_is_the_same_each_time(solved, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "FRAMES", 6)
    _, full, original, linear = solved
    for name in ("one.gif", "other.gif"):
        animation.write(tmp_path / name, full, original, linear, seconds=0.5)
    with Image.open(tmp_path / "one.gif") as picture:
        assert len(list(ImageSequence.Iterator(picture))) > animation.FRAMES / 3
        assert picture.info["loop"] == 0
    assert (tmp_path / "one.gif").read_bytes() == (tmp_path / "other.gif").read_bytes()
