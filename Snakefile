"""The paper, rebuilt: scenes are solved, reduced, timed, compared and drawn.

snakemake --cores 2                                     all that config/config.yaml asks for
snakemake --cores 2 --configfile config/small.yaml      another configuration instead
snakemake --cores 2 results/damped/uniform12/pod.nc     one result, and the ancestors it lacks
snakemake --cores 2 lifted                              lifted models: thresholds, certified errors
snakemake --cores 2 benchmarks                          run time against error of every method
snakemake --cores 2 surveys                             thousands of queries at other parameters
snakemake --cores 2 stability                           where every method is stable, and what breaks it
"""


report: "workflow/report/opening.rst"


include: "workflow/rules/common.smk"
include: "workflow/rules/solve.smk"
include: "workflow/rules/reduce.smk"
include: "workflow/rules/studies.smk"
include: "workflow/rules/survey_paths.smk"
include: "workflow/rules/surveys.smk"
include: "workflow/rules/report.smk"


if Path(workflow.basedir) == ROOT:

    # Of a workflow that uses this one as a module, other files are its own.
    include: "workflow/rules/unknown.smk"


include: "workflow/rules/records.smk"


onstart:
    if not OUTPUT.exists():
        try:
            OUTPUT.mkdir(parents=True)
            # What the pipeline makes is no part of anybody's repository.
            (OUTPUT / ".gitignore").write_text("*\n")
        except OSError as error:
            stop(f"output = {OUTPUT}: this folder cannot be made ({error.strerror})")
    # Snakemake limits itself to 100 new jobs a second, by a timer for every decision it makes; with
    # jobs as short as these the timers take 5 % of a rebuild. A higher max-jobs-per-timespan, the
    # documented key, sets as many timers.
    # A cluster has limits of its own.
    if workflow.local_exec:
        workflow.scheduler.job_rate_limiter = None


config["opening"] = summary.opening(OUTPUT / "results")


rule all:
    default_target: True
    input:
        expand("<figures>/{name}.{form}", name=FIGURES, form=["pdf", "png"]),
        tables("all"),
        expand("<results>/claims.{form}", form=["csv", "html", "md"]) if CLAIMS else [],
        expand(
            "<results>/{table}.{form}",
            table=["conventions", "errata", "reference_errors"],
            form=["csv", "html"],
        )
        if paper.applies(CONFIG)
        else [],


rule lifted:
    input:
        expand(
            "<results>/{table}.{form}",
            table=["thresholds", "effectivity", "certificates"],
            form=["csv", "html"],
        ),


rule benchmarks:
    input:
        rules.lifted.input,
        expand("<figures>/{name}.{form}", name=BENCHMARK_FIGURES, form=["pdf", "png"]),
        tables("benchmarks"),


rule stability:
    input:
        expand("<figures>/{name}.{form}", name=STABILITY_FIGURES, form=["pdf", "png"]),
        tables("stability"),
        # Full SPH of every scene holds in its attributes and its log what is predicted of it.
        expand("<results>/{scene}/sph.nc", scene=SCENES),


rule surveys:
    input:
        [file for survey in SURVEYS for file in survey_files(survey)],
