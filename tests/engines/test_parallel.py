# SPDX-License-Identifier: MIT
"""The recipe for GNU parallel, with two machines: a private sshd at two addresses of lo."""

import getpass
import os
import re
import shutil
import signal
import socket
import subprocess

import pytest

import campaigns
from campaigns import need
from engine import fixture_gate, fixture_place  # pylint: disable=unused-import
from ports import free_port
from simtool import CANWIRE, ROOT, TIMEOUT_S

CONFIG = """
Port {port}
ListenAddress 127.0.0.1
ListenAddress 127.0.0.2
HostKey {folder}/host
AuthorizedKeysFile {folder}/user.pub
StrictModes no
UsePAM no
PasswordAuthentication no
KbdInteractiveAuthentication no
PidFile none
MaxStartups 100
SetEnv PATH={path}
"""
SSH = "ssh -F none -p {port} -i {folder}/user -o IdentitiesOnly=yes -o LogLevel=ERROR " \
    "-o StrictHostKeyChecking=no -o UserKnownHostsFile=/dev/null -o ConnectTimeout=60"


def answers(port):
    with socket.socket() as client:
        return client.connect_ex(("127.0.0.2", port)) == 0


@pytest.fixture(name="hosts")
def fixture_hosts(gate, tmp_path_factory):
    """A file for --sshloginfile with two machines of one job; canwire there is that of the gate."""
    need("parallel", "sshd", "ssh", "ssh-keygen", "rsync")
    if os.geteuid() == 0:
        os.makedirs("/run/sshd", exist_ok=True)  # its folder, which is always empty
    folder, port = tmp_path_factory.mktemp("sshd"), free_port()
    for name in "host", "user":
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", folder / name],
                       check=True)
    path = f"{gate.tool.parent}:/usr/bin:/bin"
    (folder / "config").write_text(CONFIG.format(folder=folder, port=port, path=path))
    daemon = shutil.which("sshd", path="/usr/sbin:/sbin:/usr/bin")  # it wants its whole path
    with open(folder / "log", "wb") as log:
        sshd = subprocess.Popen(  # pylint: disable=consider-using-with
            [daemon, "-D", "-e", "-f", folder / "config"], stderr=log)
    try:
        campaigns.wait_for(lambda: sshd.poll() is not None or answers(port))
        assert sshd.poll() is None, (folder / "log").read_text()
        login = SSH.format(port=port, folder=folder)
        (folder / "hosts").write_text("".join(
            f"1/{login} {getpass.getuser()}@127.0.0.{n}\n" for n in (1, 2)))
        yield folder / "hosts"
    finally:
        sshd.terminate()
        sshd.wait(TIMEOUT_S)


def start(hosts):
    """Starts the recipe, as a process group."""
    recipe = ["sh", ROOT / "config/campaign/parallel.sh", "campaign.yaml", "8", hosts]
    return subprocess.Popen(recipe, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                            start_new_session=True)


def run_here(place, folder):
    """Runs the recipe on this machine alone, with canwire of a folder."""
    need("parallel")
    (place / "hosts").write_text("2/:\n")
    return subprocess.run(
        ["sh", ROOT / "config/campaign/parallel.sh", "campaign.yaml", "3", "hosts"],
        env=os.environ | {"PATH": f"{folder}:{os.environ['PATH']}"}, text=True, check=False,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, timeout=TIMEOUT_S)


def test_this_machine(place):
    result = run_here(place, os.path.dirname(CANWIRE))
    assert result.returncode == 3, result.stdout + result.stderr  # rows have failed
    assert (place / "campaign.ndjson").read_bytes() == campaigns.rows("campaign.yaml", place)
    assert not list(place.glob("canwire-*"))


def test_it_says_where_the_messages_of_failed_shards_are(place):
    tool = place / "bin/canwire"
    tool.parent.mkdir()
    tool.write_text(f'#!/bin/sh\n[ "$2" = files ] && exec {CANWIRE} "$@"\n'
                    'echo broken >&2\nexit 1\n')
    tool.chmod(0o755)
    result = run_here(place, tool.parent)
    assert result.returncode == 1, result.stdout + result.stderr
    assert "a shard has failed; messages are in campaign.rows/*.ndjson.err" in result.stderr
    assert "broken\n" in (place / "campaign.rows/1.ndjson.err").read_text()
    assert not list(place.glob("canwire-*"))


def test_killed_jobs_and_a_killed_parallel(place, gate, hosts):
    first = start(hosts)
    os.kill(list(gate.wait())[1], signal.SIGKILL)
    gate.wait()  # parallel has tried it again
    log = place / "campaign.rows/log"
    campaigns.wait_for(lambda: log.exists() and len(re.findall(r" \d/8\b", log.read_text())) == 7)
    os.killpg(first.pid, signal.SIGKILL)
    first.communicate(timeout=TIMEOUT_S)
    assert sorted(gate.runs()) == sorted([*(f"{k}/8" for k in range(1, 9)), "5/8"])
    assert not (place / "campaign.ndjson").exists()

    gate.open()
    second = start(hosts)
    out, errors = second.communicate(timeout=TIMEOUT_S)
    assert second.returncode == 3, out + errors  # rows have failed
    assert "780 rows: " in errors
    assert (place / "campaign.ndjson").read_bytes() == campaigns.rows("campaign.yaml", place)
    again = gate.runs()
    assert again[-1] == "1/1" and "5/8" in again and len(again) < 5, again
