"""Call the function that a rule of a survey names, and write what it returns."""

from sphpod.pipeline import dataset, job
from sphpod.studies import study
from sphpod.surveys import jobs

if __name__ == "__main__":
    given = job.start(snakemake)
    params = snakemake.params
    of_survey = params.scene, params.physics, params.survey
    settings = {"scene": params.scene, "physics": params.physics, "survey": params.survey}
    if params.alone:
        from sphpod.numerics import timing

        settings["machine"] = timing.machine()
    # Of many files one is held at a time.
    inputs = {
        name: dataset.read(files) if isinstance(files, str) else map(dataset.read, files)
        for name, files in snakemake.input.items()
    }
    function = study.function(f"surveys.jobs.{params.compute}")
    dataset.write(
        snakemake.output[0],
        function(*of_survey, **inputs, **params.arguments),
        title=f"{snakemake.wildcards.survey}: {function.__doc__.partition('.')[0]}",
        settings=settings,
        code=params.code,
        job=given,
        variables=jobs.meanings(*of_survey),
    )
