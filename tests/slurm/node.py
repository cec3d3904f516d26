"""One node of SLURM in a temporary folder: its three daemons run as this user, without systemd or cgroups."""

import contextlib
import os
import secrets
import shutil
import socket
import subprocess
import tempfile
import time
from getpass import getuser
from pathlib import Path

import pytest

PATH = os.environ["PATH"] + ":/usr/sbin:/sbin"
DAEMONS = ("munged", "slurmctld", "slurmd")
CONFIGURATION = """
ClusterName=symid
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SlurmdParameters=config_overrides
ReturnToService=2
NodeName={host} NodeAddr=127.0.0.1 CPUs={cores} RealMemory=4000 State=UNKNOWN
PartitionName=all Nodes={host} Default=YES MaxTime=INFINITE State=UP
"""


def find_free_ports(count):
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


class SlurmNode:
    """The node; `variables` let programs of SLURM find it."""

    def __init__(self):
        for name in DAEMONS:
            assert shutil.which(name, path=PATH), f"{name} is not here: make test-slurm says what to install"
        # Munge wants a short path, and no folder on it that others can write to.
        self.folder = Path(tempfile.mkdtemp(prefix="symid-test-slurm-"))
        self.folder.chmod(0o755)
        self.variables = os.environ | {"PATH": PATH, "SLURM_CONF": str(self.folder / "slurm.conf")}
        self.processes = []

    def __enter__(self):
        folder = self.folder
        for name in ("state", "spool"):
            (folder / name).mkdir()
        (folder / "munge.key").touch(mode=0o600)
        (folder / "munge.key").write_bytes(secrets.token_bytes(128))
        known = {"host": socket.gethostname().split(".")[0], "user": getuser(), "folder": folder}
        text = CONFIGURATION.format(**known, ports=find_free_ports(2), cores=os.cpu_count())
        (folder / "slurm.conf").write_text(text)
        files = {"key-file": "munge.key", "socket": "munge.socket", "pid-file": "munged.pid"}
        files |= {"seed-file": "munged.seed", "log-file": "munged.log"}
        try:
            self._start(
                "munged", "--foreground", *(f"--{key}={folder / name}" for key, name in files.items())
            )
            self._wait("munge", "--socket", str(folder / "munge.socket"), "--no-input")
            self._start("slurmctld", "-D")
            self._start("slurmd", "-D")
            self._wait("srun", "--immediate=1", "true")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            self.run("scancel", "--user", getuser())
            self.wait_until_idle()
        for process in reversed(self.processes):
            process.terminate()
            try:
                process.wait(60)
            except subprocess.TimeoutExpired:
                process.kill()
        shutil.rmtree(self.folder, ignore_errors=True)

    def run(self, *command):
        """Return what a program of SLURM prints."""
        done = subprocess.run(
            command, env=self.variables, capture_output=True, text=True, check=False, timeout=60
        )
        return done.stdout

    def wait_until_idle(self):
        """Return whether no job is left, after a minute at most."""
        for _ in range(120):
            if not self.run("squeue", "--noheader").strip():
                return True
            time.sleep(0.5)
        return False

    def _start(self, name, *options):
        with (self.folder / f"{name}.said").open("wb") as said:
            process = subprocess.Popen([name, *options], env=self.variables, stdout=said, stderr=said)
        self.processes.append(process)

    def _wait(self, *command):
        """Wait until a program ends well."""
        for _ in range(60):
            quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            if subprocess.run(command, env=self.variables, check=False, timeout=60, **quiet).returncode == 0:
                return
            time.sleep(0.5)
        said = "\n".join(path.read_text(errors="replace")[-1500:] for path in self.folder.glob("*.said"))
        pytest.fail(f"{command[0]} does not end well:\n{said}")
