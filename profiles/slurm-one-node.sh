#!/bin/bash
#SBATCH --job-name=sphpod
#SBATCH --nodes=1
#SBATCH --exclusive
#SBATCH --mem=0
#SBATCH --time=60
#SBATCH --output=sphpod-%j.log
# All of it in one job on a node of its own: sbatch profiles/slurm-one-node.sh [targets and options]
exec .venv/bin/snakemake --cores "$SLURM_CPUS_ON_NODE" "$@"
