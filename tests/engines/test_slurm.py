# SPDX-License-Identifier: MIT
"""The recipe for Slurm: a controller, a node and munge of the test's own, on lo, as this user."""

import contextlib
import getpass
import os
import shutil
import socket
import subprocess

import pytest

import campaigns
from campaigns import need
from engine import fixture_gate, fixture_place  # pylint: disable=unused-import
from ports import free_port
from simtool import CANWIRE, ROOT, TIMEOUT_S

PATH = f"{os.environ['PATH']}:/usr/sbin:/sbin"
# A task that is put into the queue again waits until its credential has expired.
CONFIG = """ClusterName=canwire
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket={folder}/munge.socket,cred_expire=5
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=1,sched_min_interval=1,batch_sched_delay=0
ReturnToService=2
KillWait=1
NodeName={host} NodeAddr=127.0.0.1 CPUs={cpus} State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def said(*words, **more):
    """Returns the output of a program, which must end well."""
    done = subprocess.run(words, capture_output=True, text=True, timeout=TIMEOUT_S, check=False,
                          env={**os.environ, "PATH": f"{os.environ['PATH']}:/usr/sbin"}, **more)
    assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"
    return done.stdout


@contextlib.contextmanager
def running(folder, *words):
    """Runs a daemon in the foreground until the end of the block."""
    program = shutil.which(words[0], path=PATH)
    with open(folder / f"{words[0]}.out", "wb") as out:
        process = subprocess.Popen([program, *words[1:]], stdout=out, stderr=out)
    try:
        yield process
    finally:
        process.terminate()
        process.wait(TIMEOUT_S)


def answers(*words):
    return subprocess.run(words, capture_output=True, timeout=TIMEOUT_S, check=False)


@pytest.fixture(name="slurm")
def fixture_slurm(tmp_path_factory, monkeypatch, gate):
    """A cluster with one node of two processors; its folder."""
    need("munged", "slurmctld", "slurmd", "sbatch")
    folder, host = tmp_path_factory.mktemp("slurm"), socket.gethostname().split(".")[0]
    for name in "state", "spool":
        (folder / name).mkdir()
    (folder / "munge.key").write_bytes(os.urandom(1024))
    (folder / "munge.key").chmod(0o400)
    (folder / "slurm.conf").write_text(CONFIG.format(
        host=host, user=getpass.getuser(), folder=folder, ports=[free_port(), free_port()],
        cpus=min(os.cpu_count(), 2)))
    monkeypatch.setenv("SLURM_CONF", str(folder / "slurm.conf"))
    files = [f"--{name}={folder}/munge.{end}" for name, end in (
        ("key-file", "key"), ("socket", "socket"), ("pid-file", "pid"), ("log-file", "log"),
        ("seed-file", "seed"))]
    with running(folder, "munged", "--foreground", "--force", *files):
        campaigns.wait_for((folder / "munge.socket").exists)
        with running(folder, "slurmctld", "-D") as controller, running(folder, "slurmd", "-D"):
            campaigns.wait_for(lambda: controller.poll() is not None or
                               b"idle" in answers("sinfo", "-h", "-o", "%T").stdout)
            assert controller.poll() is None, (folder / "slurmctld.out").read_text()
            yield folder
            gate.open()
            answers("scancel", "--user", getpass.getuser())
            wait_for_jobs()


def wait_for_jobs(most=0):
    """Waits until no more tasks than that are in the queue."""
    campaigns.wait_for(lambda: len(said("squeue", "-h", "-r").splitlines()) <= most)


def submit(*options):
    return said("sbatch", "--parsable", *options).strip()


def test_killed_and_requeued_tasks(place, gate, slurm):
    assert slurm.exists()
    shutil.copy(ROOT / "config/campaign/slurm.sbatch", place)
    recipe = ["slurm.sbatch", "campaign.yaml", "8"]
    job = submit("--array=1-8", *recipe)
    gate.wait()
    wait_for_jobs(1)
    said("scancel", "--full", "--signal=KILL", f"{job}_5")
    wait_for_jobs()
    done = sorted(path.name for path in (place / "rows").glob("*.ndjson"))
    assert done == [f"{k:07}.ndjson" for k in (1, 2, 3, 4, 6, 7, 8)]
    gate.runs()

    job = submit("--array=5", *recipe)  # it alone
    gate.wait()
    said("scontrol", "requeue", f"{job}_5")
    gate.wait()
    gate.open()
    wait_for_jobs()
    assert gate.runs() == ["5/8", "5/8"]
    commands = [line.strip("# ") for line in (place / "slurm.sbatch").read_text().splitlines()
                if line.startswith(("#   cat", "#   canwire"))]
    script = "\n".join(commands).replace("FILE", "campaign.yaml")
    subprocess.run(["sh", "-c", script], check=False, timeout=TIMEOUT_S)
    assert (place / "rows.ndjson").read_bytes() == campaigns.rows("campaign.yaml", place)


def test_a_whole_array_needs_no_option_and_a_part_of_one_is_refused(place, slurm):
    assert slurm.exists()
    command = f"{CANWIRE} campaign run campaign.yaml --jobs 1 --out $SLURM_ARRAY_TASK_ID.rows"
    submit("--array=0-3", "--wrap", command)
    wait_for_jobs()
    rows = b"".join((place / f"{k}.rows").read_bytes() for k in range(4))
    assert rows == campaigns.rows("campaign.yaml", place)
    job = submit("--array=2,3", "--wrap", command.replace(".rows", ".again"))
    wait_for_jobs()
    for task in 2, 3:
        assert "SLURM_ARRAY_TASK_MIN to SLURM_ARRAY_TASK_MAX are 2 to 3, with 2 tasks: that may " \
            "be a part of an array; give --shard K/N" in (place / f"slurm-{job}_{task}.out"
                                                          ).read_text()
    assert not list(place.glob("*.again"))
