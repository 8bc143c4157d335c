"""Results let Snakemake know what they come from, where it does not know.

Snakemake keeps the parameters and inputs of each result in `.snakemake`. Of results that were
copied here, or that have lost that folder, they stand in the results themselves and in their logs
(`sphpod/pipeline/job.py`). These are handed over before Snakemake decides what to make anew; it then does
so, and says why, as if it had made the results here itself."""

from snakemake.persistence import RECORD_FORMAT_VERSION, MetadataRecord
from snakemake.persistence.file import FilePersistence

from sphpod.pipeline import job


def known_record(store, path):
    """What Snakemake knows of a result, and whether that is the very file that lies there."""
    known = store._read_record(str(path))
    return known, known is not None and known.endtime == path.stat().st_mtime


def hand_over(store, path, known, given=None, root=None, made=None):
    """Let Snakemake know what the job that wrote a result was given; nothing if nobody knows."""
    if given is None and known is not None:
        return
    made = path.stat().st_mtime if made is None else made
    record = MetadataRecord(
        record_format_version=RECORD_FORMAT_VERSION, params=[], incomplete=False
    )
    record.starttime, record.endtime = made, made
    if given is not None:
        record.job_hash = hash(str(given["log"]))
        record.rule, record.params = given["rule"], given["params"]
        record.input, record.log = (
            sorted(str(root / name) for name in given[kind]) for kind in ("input", "log")
        )
        record.input_checksums = {
            str(root / name): f"sha256:{checksum}" for name, checksum in given["checksums"].items()
        }
    store._write_record(str(path), record)


def is_asked_for(path, scenes):
    producers = (each.is_producer(str(OUTPUT / "results" / path)) for each in makers())
    return path.parts[0] in scenes and any(producers)


def hand_over_datasets(store):
    results = OUTPUT / "results"
    scenes = {*SCENES, *CONFIG["stability"]["edge_scenes"]}
    for path in results.rglob("[!.]*.nc"):
        known, is_unchanged = known_record(store, path)
        if is_unchanged:
            continue
        try:
            hand_over(store, path, known, job.given(path), results)
        except ValueError as error:
            if is_asked_for(path.relative_to(results), scenes):
                stop(error)


def hand_over_tables_and_figures(store):
    """These cannot hold what they come from; their logs do."""
    results, figures = OUTPUT / "results", OUTPUT / "figures"
    made = {}
    for folder, root in ((results / "logs", results), (results / "logs/figures", OUTPUT)):
        for log in folder.glob("*.log"):
            if given := job.given_in_log(log):
                made |= {root / name: (given, root) for name in given["output"]}
    for folder, form in (
        (results, "csv"),
        (results, "html"),
        (results, "md"),
        (figures, "pdf"),
        (figures, "png"),
    ):
        for path in folder.glob(f"[!.]*.{form}"):
            known, is_unchanged = known_record(store, path)
            if not is_unchanged:
                hand_over(store, path, known, *made.get(path, ()))


def hand_over_missing(store):
    """Results that have gone, whose logs are left: they must not hide that they were out of date."""
    results = OUTPUT / "results"
    for log in (results / "logs").rglob("*.log"):
        given = job.given_in_log(log)
        root = OUTPUT if log.parent == results / "logs/figures" else results
        for path in [root / name for name in given["output"]] if given else []:
            if not path.exists() and store._read_record(str(path)) is None:
                hand_over(store, path, None, given, root, log.stat().st_mtime)


if workflow.is_main_process and (OUTPUT / "results").is_dir():
    store = FilePersistence()
    hand_over_datasets(store)
    hand_over_tables_and_figures(store)
    hand_over_missing(store)
