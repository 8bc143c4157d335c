"""Call the function that a rule names with scene, inputs and arguments; write what it returns."""

import inspect

from sphpod import bar
from sphpod.pipeline import dataset, job
from sphpod.scene.scene import Scene
from sphpod.studies import study

if __name__ == "__main__":
    given = job.start(snakemake)
    params, place = snakemake.params, dict(snakemake.wildcards)
    settings = {**place, **params.physics, **params.arguments}
    if params.sampling:
        settings["sampling"] = {"name": place["sampling"], **params.sampling}
    if params.alone:
        from sphpod.numerics import timing

        settings["machine"] = timing.machine()
    scene = Scene.from_settings(place["scene"], params.physics)
    reader = dataset.read if params.all_times else dataset.read_samples

    def read(path):
        return bar.of_line(scene, reader(path))

    inputs = {
        name: read(files) if isinstance(files, str) else list(map(read, files))
        for name, files in snakemake.input.items()
    }
    function = study.function(params.compute)
    if "scene" in inspect.signature(function).parameters:
        inputs["scene"] = scene
    meaning = inspect.getdoc(function).partition("\n")[0].rstrip(".")
    variables = study.variables(params.compute)
    dataset.write(
        snakemake.output[0],
        bar.of_bar(scene, function(**inputs, **params.arguments), variables),
        title=f"{', '.join(place.values())}: {meaning}",
        settings=settings,
        code=params.code,
        job=given,
        variables=variables,
    )
