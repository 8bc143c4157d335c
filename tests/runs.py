"""Snakemake in a process of its own."""

import os
import subprocess
import sys


def command(*arguments):
    return [sys.executable, "-m", "snakemake", "--cores", "2", *map(str, arguments)]


def run(folder, *arguments, **environment):
    """What Snakemake says and returns in a folder."""
    env = os.environ | environment
    return subprocess.run(
        command(*arguments), cwd=folder, env=env, capture_output=True, text=True, check=False
    )
