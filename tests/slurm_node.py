"""A SLURM of one node on this machine, for a test: its three daemons on 127.0.0.1.

As root, on Debian or Ubuntu, whose packages are installed where they are missing. All that the
daemons write is in one folder, but for the configuration, which SLURM finds in /etc/slurm.
"""

import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

PACKAGES = {
    "munged": "munge",
    "slurmctld": "slurmctld",
    "slurmd": "slurmd",
    "sbatch": "slurm-client",
}
CONFIGURATION = Path("/etc/slurm/slurm.conf")
PATH = {"PATH": f"{os.environ['PATH']}:/usr/sbin:/sbin", "DEBIAN_FRONTEND": "noninteractive"}


def impossible() -> str:
    """Why there can be no such node here; empty if there can."""
    if os.geteuid() != 0:
        return "SLURM's daemons are started as root"
    if not shutil.which("apt-get"):
        return "SLURM is installed by apt-get"
    if CONFIGURATION.exists():
        return f"this machine has a SLURM of its own, {CONFIGURATION}"
    return ""


class Unavailable(Exception):
    """The packages are not to be had here."""


def run(*command: str, seconds: float = 120) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command, env=os.environ | PATH, capture_output=True, text=True, timeout=seconds, check=True
    )


@contextmanager
def node(folder: Path) -> Iterator[None]:
    """The node, until the end of the context; no daemon is left then.

    Raises
    ------
    Unavailable
        SLURM is not installed, and cannot be.
    """
    _install()
    folder.chmod(0o755)
    CONFIGURATION.parent.mkdir(parents=True, exist_ok=True)
    CONFIGURATION.write_text(_configuration(folder))
    key = folder / "munge.key"
    key.touch(mode=0o600)
    key.write_bytes(os.urandom(1024))
    try:
        names = {"socket": "munge.socket", "pid-file": "munged.pid", "log-file": "munged.log",
                 "seed-file": "munge.seed", "key-file": "munge.key"}  # fmt: skip
        run("munged", "--force", *(f"--{name}={folder / file}" for name, file in names.items()))
        run("slurmctld", "-i")
        run("slurmd", "-N", "node")
        _wait(60, lambda: "idle" in run("sinfo", "--noheader", "--format=%T").stdout)
        run("sbatch", "--wait", "--mem=10", "--output=/dev/null", "--wrap=true")
        yield
    finally:
        with suppress(subprocess.SubprocessError):
            run("scancel", "--user=root")
            _wait(60, lambda: not run("squeue", "--noheader").stdout.strip())
        for name in ("slurmd", "slurmctld", "munged"):
            _end(folder / f"{name}.pid")
        CONFIGURATION.unlink()


def _install() -> None:
    missing = [
        package
        for program, package in PACKAGES.items()
        if not shutil.which(program, path=PATH["PATH"])
    ]
    if not missing:
        return
    # The services of the packages have no configuration, and must not start with them.
    policy = Path("/usr/sbin/policy-rc.d")
    own = not policy.exists()
    if own:
        policy.write_text("#!/bin/sh\nexit 101\n")
        policy.chmod(0o755)
    try:
        run("apt-get", "-qq", "update", seconds=180)
        run("apt-get", "-qq", "install", "--yes", "--no-install-recommends", *missing, seconds=300)
    except subprocess.SubprocessError as error:
        raise Unavailable(f"apt-get gives no {', '.join(missing)}: {error}") from error
    finally:
        if own:
            policy.unlink()


def _configuration(folder: Path) -> str:
    host = socket.gethostname().split(".")[0]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") // 2**20
    ports = []
    for _ in range(2):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            ports.append(free.getsockname()[1])
    settings = {
        "ClusterName": "test",
        "SlurmctldHost": f"{host}(127.0.0.1)",
        "SlurmctldPort": ports[0],
        "CommunicationParameters": "NoCtldInAddrAny,NoInAddrAny",
        "AuthType": "auth/munge",
        "AuthInfo": f"socket={folder / 'munge.socket'}",
        "SlurmUser": "root",
        "SlurmdUser": "root",
        "StateSaveLocation": folder / "state",
        "SlurmdSpoolDir": folder / "spool",
        "SlurmctldPidFile": folder / "slurmctld.pid",
        "SlurmdPidFile": folder / "slurmd.pid",
        "SlurmctldLogFile": folder / "slurmctld.log",
        "SlurmdLogFile": folder / "slurmd.log",
        # A container has no cgroups to give: memory is watched, each second.
        "ProctrackType": "proctrack/linuxproc",
        "TaskPlugin": "task/none",
        "JobAcctGatherType": "jobacct_gather/linux",
        "JobAcctGatherFrequency": "task=1",
        "JobAcctGatherParams": "OverMemoryKill",
        "AccountingStorageType": "accounting_storage/none",
        "MinJobAge": 600,
        "MpiDefault": "none",
        "ReturnToService": 2,
        "SelectType": "select/cons_tres",
        "SelectTypeParameters": "CR_CPU_Memory",
        "SchedulerParameters": "sched_min_interval=0,batch_sched_delay=0,bf_interval=1",
        "KillWait": 5,
        "SlurmdParameters": "config_overrides",
    }
    (folder / "state").mkdir()
    # More processors than there are let jobs run beside each other.
    processors = 2 * (os.cpu_count() or 1)
    lines = [f"{key}={value}" for key, value in settings.items()]
    lines.append(
        f"NodeName=node NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[1]} CPUs={processors} "
        f"RealMemory={memory}"
    )
    lines.append("PartitionName=main Nodes=ALL Default=YES MaxTime=60 State=UP")
    return "\n".join(lines) + "\n"


def _wait(seconds: float, done: Callable[[], bool]) -> None:
    end = time.monotonic() + seconds
    while not done():
        if time.monotonic() > end:
            raise TimeoutError(f"not within {seconds:g} s")
        time.sleep(0.1)


def _end(pid_file: Path) -> None:
    with suppress(FileNotFoundError, ProcessLookupError, ValueError):
        pid = int(pid_file.read_text())
        os.kill(pid, signal.SIGTERM)
        _wait(60, lambda: not Path(f"/proc/{pid}").exists())
