"""Find the modes of velocity and density snapshots by proper orthogonal decomposition."""

from sphpod.pipeline import dataset, job
from sphpod.reduced import pod

if __name__ == "__main__":
    given = job.start(snakemake)
    settings = dataset.settings(snakemake.input.snapshots)
    dataset.write(
        snakemake.output[0],
        pod.decompose(dataset.read(snakemake.input.snapshots)),
        title=f"Modes of the snapshots {settings['sampling']['name']} of {settings['scene']}",
        settings=settings,
        code=snakemake.params.code,
        job=given,
    )
