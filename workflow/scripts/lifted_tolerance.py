"""Choose the smallest lifted model that meets a tolerance, and say whether that is certified."""

import logging

from sphpod import bar
from sphpod.pipeline import dataset, job
from sphpod.reduced import certificate
from sphpod.scene.scene import Scene

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.pod)
    scene = Scene.from_settings(settings["scene"], settings)
    tolerance = float(snakemake.wildcards.tolerance)
    modes = bar.of_line(scene, dataset.read(snakemake.input.pod))
    arrays = certificate.choose(scene, tolerance, modes)
    verdict = certificate.verdict(arrays)
    logging.getLogger("lifted_tolerance").info(verdict)
    dataset.write(
        snakemake.output[0],
        bar.of_bar(scene, arrays),
        title=f"Lifted reduced model of {scene.name}: {verdict}",
        settings=settings | {"method": "lifted_exact", "tolerance": tolerance},
        code=snakemake.params.code,
        job=given,
    )
