"""What studies vary of scenes, checked once all scenes are known."""

from typing import Any

from sphpod.config.boundary import check_ends
from sphpod.config.reading import ConfigError, refusal
from sphpod.config.scene_section import known_names
from sphpod.scene import checks
from sphpod.scene.scene import Scene
from sphpod.studies.variants import CHANGES, OWN


def check_pairs(config: dict[str, Any]) -> None:
    """Check samplings of which both mode counts are varied."""
    for name, samplings in config["studies"]["mode_pairs"]["samplings"].items():
        key = "studies.mode_pairs.samplings"
        if name not in config["scenes"]:
            known = ", ".join(config["scenes"])
            raise refusal(None, key, name, f"no such scene; allowed are {known}")
        check_ends(name, config["scenes"][name])
        for sampling in samplings:
            if sampling not in (known := config["scenes"][name]["samplings"]):
                raise refusal(None, f"{key}.{name}", sampling, known_names("sampling", known))


def check_variants(config: dict[str, Any], share: float) -> None:
    """Check runs of full SPH that differ from a scene in a key or two."""
    for name, runs in config["studies"]["variants"]["runs"].items():
        key = "studies.variants.runs"
        if name not in config["scenes"]:
            known = ", ".join(config["scenes"])
            raise refusal(None, key, name, f"no such scene; allowed are {known}")
        for variant, changes in runs.items():
            if variant == OWN:
                raise refusal(None, f"{key}.{name}", OWN, "this is the name of the scene itself")
            for change, value in changes.items():
                if change not in CHANGES:
                    allowed = f"unknown here; allowed are {', '.join(CHANGES)}"
                    raise refusal(None, f"{key}.{name}.{variant}.{change}", value, allowed)
            settings = {**config["scenes"][name], **changes}
            if settings["particle_count"] != int(settings["particle_count"]):
                whole = "it must be a whole number"
                raise refusal(None, f"{key}.{name}.{variant}.particle_count", changes, whole)
            settings["particle_count"] = int(settings["particle_count"])
            try:
                checks.check(Scene.from_settings(name, settings), share)
            except ValueError as error:
                raise ConfigError(f"{key}.{name}.{variant}: {error}") from error
