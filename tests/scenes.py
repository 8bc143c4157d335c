"""Small scenes for the tests."""

from sphpod.scene.scene import Scene

WAVE = "1e-3*sin(2*pi*x/L) + 5e-4*cos(4*pi*x/L)"


def settings(**changes):
    """Settings of an undamped uniform scene of 40 particles over one second, with the changes."""
    usual = {
        "domain_length": 1,
        "duration": 1,
        "initial_velocity": WAVE,
        "initial_density": 1,
        "youngs_modulus": 0.1,
        "particle_count": 40,
        "smoothing_ratio": 1.04,
        "time_step": 1e-3,
        "error_interval": 0.01,
    }
    return usual | changes


def scene(name="test", **changes):
    """The scene of these settings."""
    return Scene.from_settings(name, settings(**changes))


VARIED = {
    "initial_density": "1 + 0.3*sin(2*pi*x/L)",
    "youngs_modulus": "0.1 + 0.05*cos(2*pi*x/L)",
    "damping": "1 + sin(2*pi*x/L)",
    "force": {"time": "1e-3*cos(20*t)", "profile": "1 + x*(L - x)"},
}
"""Material, damping and force that all vary in space."""
