"""Random lifted reduced models for the tests."""

import numpy as np
from hypothesis import strategies as st
from scenes import scene

from sphpod.reduced.lifted_rom import LiftedModel


def rows(rng, count, size):
    """Random orthonormal rows."""
    return np.linalg.qr(rng.standard_normal((size, count)))[0].T


@st.composite
def random_models(draw):
    """Any scene without a force, any modes, any number of them."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = draw(st.integers(7, 24))

    def profile(size, depth):
        depth, shift, wave = rng.uniform(0, depth), rng.uniform(0, 6), rng.integers(1, 4)
        return f"{size}*(1 + {depth}*sin(2*pi*{wave}*x/L + {shift}))"

    changes = {
        "particle_count": count,
        "smoothing_ratio": draw(st.sampled_from([0.9, 1.04, 1.7])),
        "initial_density": profile(rng.uniform(0.5, 2), 0.9),
        "youngs_modulus": profile(rng.uniform(0.05, 0.5), 0.9),
        "damping": draw(st.sampled_from([0, rng.uniform(0, 40), profile(rng.uniform(0, 40), 1)])),
        "initial_velocity": profile(1e-3, 3),
        "duration": 5,
        "error_interval": 0.05,
    }
    kv = draw(st.integers(1, count))
    ke = draw(st.integers(0, kv))
    return LiftedModel(scene(**changes), rows(rng, kv, count), rows(rng, ke, count), 0)
