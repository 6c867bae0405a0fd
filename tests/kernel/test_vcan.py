# SPDX-License-Identifier: MIT
"""canwire vcan: the interfaces of a configuration are made and removed, others stay as they are."""

import ctypes
import errno
import json
import os
import shutil
import socket
import subprocess

import pytest

from canbits import FD, Frame
from conftest import ROOT, CanSocket, ip

pytestmark = pytest.mark.kept

CANWIRE = os.environ.get("CANWIRE") or ROOT / "build/release/canwire"
LIBC = ctypes.CDLL(None, use_errno=True)
CLONE_NEWNET = 0x40000000
HEAD = "bus: { name: rig, bitrate: 500000 }\nnodes:\n"
PAIR = HEAD + "  - { name: a, port: v0 }\n  - { name: b, port: v1 }\n"
PEERS = HEAD + (
    "  - { name: a, port: v0, peer: { name: can0, netns: ecu1 } }\n"
    "  - { name: b, port: v1, peer: { name: can0, netns: ecu2 } }\n"
    "  - { name: c, port: v2, peer: { name: v3 } }\n"
)


@pytest.fixture
def rig(tmp_path):
    """rig("up", TEXT) runs canwire vcan; what it leaves goes with the test."""
    file = tmp_path / "rig.yaml"

    def run(verb, text=None, status=0, **more):
        if text is not None:
            file.write_text(text)
        done = subprocess.run(
            [more.pop("tool", CANWIRE), "vcan", verb, more.pop("name", file)],
            capture_output=True, text=True, check=False, **more,
        )
        assert done.returncode == status, done
        return done.stderr if status else done.stdout

    run.file = file
    yield run
    for link in links():
        if link != "lo":
            subprocess.run(["ip", "link", "del", link], check=False, stderr=subprocess.DEVNULL)


@pytest.fixture
def netns():
    """netns("ecu1", …) makes network namespaces."""
    made = []

    def make(*names):
        for name in names:
            subprocess.run(["ip", "netns", "add", name], check=True)
            made.append(name)

    yield make
    for name in made:
        subprocess.run(["ip", "netns", "del", name], check=True)


def links(netns=None):
    """Returns {name: report of `ip`}."""
    where = ["-n", netns] if netns else []
    text = subprocess.run(
        ["ip", *where, "-json", "-details", "link", "show"],
        check=True, stdout=subprocess.PIPE, text=True,
    ).stdout
    return {link["ifname"]: link for link in json.loads(text)}


def kind(link):
    return link["linkinfo"]["info_kind"]


def is_up(link):
    return "UP" in link["flags"]


def enter(path):
    with open(path, encoding="ascii") as namespace:
        assert LIBC.setns(namespace.fileno(), CLONE_NEWNET) == 0, os.strerror(ctypes.get_errno())


def socket_in(netns):
    """Opens a CAN socket in a namespace: this thread goes there and comes back."""
    with open("/proc/thread-self/ns/net", encoding="ascii") as here:
        enter(f"/run/netns/{netns}")
        try:
            return CanSocket("can0")
        finally:
            enter(f"/proc/self/fd/{here.fileno()}")


def test_ports_become_vcan_and_go_again(rig):
    assert rig("up", PAIR) == "made v0\nmade v1\n"
    for name in ("v0", "v1"):
        link = links()[name]
        assert (kind(link), is_up(link), link["ifalias"]) == ("vcan", True, f"canwire {rig.file}")
    assert rig("up") == ""
    assert rig("down") == "removed v0\nremoved v1\n"
    assert set(links()) == {"lo"}
    assert rig("down") == f"no interface of {rig.file} is there\n"


def test_peers_come_into_their_namespaces_and_carry_frames(rig, netns, canwired):
    netns("ecu1", "ecu2")
    assert "made v0: can0 in ecu1\n" in rig("up", PEERS)
    assert set(links()) == {"lo", "v0", "v1", "v2", "v3"}
    for name, where in (("can0", "ecu1"), ("can0", "ecu2"), ("v3", None)):
        link = links(where)[name]
        assert (kind(link), is_up(link)) == ("vxcan", True)
    daemon = canwired(PEERS)
    one, two = socket_in("ecu1"), socket_in("ecu2")
    one.send(Frame.parse("123#DEADBEEF"))
    assert two.receive(1) == [Frame.parse("123#DEADBEEF")]
    one.close()
    two.close()
    daemon.stop()
    rig("down")
    assert set(links()) == {"lo"}
    assert set(links("ecu1")) == {"lo"}


def test_interfaces_here_are_not_in_the_way_of_peers_elsewhere(rig, netns):
    """A rig with hardware has a can0. Indexes may be in use here, or there."""
    netns("ecu1", "ecu2")
    ip("link add can0 type vcan", "link add can1 index 1048576 type vcan")
    subprocess.run(["ip", "-n", "ecu1", "link", "add", "other", "index", "1048577", "type", "vcan"],
                   check=True)
    assert "made v0: can0 in ecu1\nmade v1: can0 in ecu2\n" in rig("up", PEERS)
    for name, where in (("can0", "ecu1"), ("can0", "ecu2"), ("v3", None)):
        link = links(where)[name]
        assert (kind(link), is_up(link)) == ("vxcan", True)
    assert kind(links()["can0"]) == "vcan"
    assert rig("up") == ""
    rig("down")
    assert set(links()) == {"lo", "can0", "can1"} and set(links("ecu1")) == {"lo", "other"}


def test_programs_that_write_can_fd_get_an_error(rig, netns):
    netns("ecu1", "ecu2")
    rig("up", PEERS)
    rig("up", PAIR.replace("v0", "w0").replace("v1", "w1"), name=rig.file)
    interfaces = [links()[name] for name in ("v0", "v1", "v2", "v3", "w0", "w1")]
    interfaces += [links(where)["can0"] for where in ("ecu1", "ecu2")]
    assert [link["mtu"] for link in interfaces] == [16] * 8
    for s in (CanSocket("w0"), CanSocket("v3"), socket_in("ecu1")):
        s.allow_fd()
        with pytest.raises(OSError) as error:
            s.send_raw(FD.pack(0x123, 8, 0, bytes(64)))
        assert error.value.errno == errno.EINVAL
        s.close()


def test_who_makes_interfaces_for_can_fd_is_warned(rig, canwired):
    ip("link add v0 type vcan", "link set v0 mtu 72", "link add v1 type vcan",
       "link set v1 mtu 16")
    rig.file.write_text(PAIR)
    done = subprocess.run([CANWIRE, "vcan", "up", rig.file], capture_output=True, text=True,
                          check=True)
    assert "v0: it exists with an MTU of 72: CAN FD frames" in done.stderr
    assert done.stderr.count("\n") == 1
    log = canwired(PAIR).stop()
    assert log.count("its MTU is 72: programs can write CAN FD frames") == 1
    assert "port v0: its MTU" in log and "2 nodes at 500000 bit/s, classical CAN\n" in log


def test_what_was_there_is_used_and_stays(rig):
    ip("link add v0 type vcan", "link add v1 type vxcan peer name other")
    assert rig("up", PAIR) == ""
    assert is_up(links()["v0"]) and is_up(links()["v1"])
    assert "ifalias" not in links()["v0"]
    assert rig("down").startswith("no interface of ")
    assert set(links()) == {"lo", "v0", "v1", "other"}


WAITS = "missing-port: wait\n"


@pytest.mark.parametrize("name", ["can0", "slcan12"])
def test_a_bus_that_waits_gets_no_vcan_in_place_of_hardware(rig, canwired, name):
    """The adapter may come later, and needs its name."""
    text = PAIR.replace("v1", name) + WAITS
    left = f"left {name} to hardware: missing-port: wait\n"
    assert rig("up", text) == "made v0\n" + left
    assert set(links()) == {"lo", "v0"} and rig("up") == left
    assert f"{name} is missing, waiting for it" in canwired(text).stop()
    ip(f"link add {name} type vcan")
    assert rig("up") == "" and is_up(links()[name]), "a vcan that somebody has made is used"
    assert rig("down") == "removed v0\n"


def test_other_names_and_other_buses_get_their_interfaces(rig, netns):
    """Those of the examples, those of peers, and all where the bus does not wait."""
    names = ["can", "can0x", "pt-engine", "vcan0", "vxcan0", "slcan", "xcan0"]
    nodes = "".join(f"  - {{ name: n{i}, port: {name} }}\n" for i, name in enumerate(names))
    assert rig("up", HEAD + nodes + WAITS) == "".join(f"made {name}\n" for name in names)
    assert rig("up", PAIR.replace("v0", "can1")) == "made can1\nmade v1\n"
    netns("ecu1", "ecu2")
    peers = PEERS.replace("v0", "can2") + WAITS
    assert rig("up", peers).startswith("made can2: can0 in ecu1\n")


def test_a_node_says_that_its_port_is_that_of_hardware(rig, canwired):
    """Whatever the name is that udev gives to it; and a bus that waits makes a can0 for a node that
    does not."""
    text = PAIR.replace("v1", "door-can, missing-port: wait")
    left = "left door-can to hardware: missing-port: wait\n"
    assert rig("up", text) == "made v0\n" + left and set(links()) == {"lo", "v0"}
    assert "door-can is missing, waiting for it" in canwired(text).stop()
    ip("link add door-can type vcan")
    assert rig("up") == "" and is_up(links()["door-can"])
    ip("link del door-can")
    assert rig("down") == "removed v0\n"
    text = PAIR.replace("v0", "can0").replace("v1", "can1, missing-port: fail") + WAITS
    assert rig("up", text) == "left can0 to hardware: missing-port: wait\nmade can1\n"


def test_an_interface_that_is_down_is_set_up(rig):
    rig("up", PAIR)
    ip("link set v1 down")
    assert rig("up") == ""
    assert is_up(links()["v1"])
    assert "v1" in rig("down"), "its alias is gone"


@pytest.mark.parametrize(
    "text, made, reason",
    [
        (PAIR, "link add v1 type dummy", "v1: it exists and is no vcan or vxcan interface"),
        (PEERS.replace("ecu1", "ns1").replace("ecu2", "ns1").replace("v1, peer: { name: can0",
                                                                     "v1, peer: { name: can1"),
         "link add v2 type vcan", "v2: it exists and is no vxcan interface, but has a peer"),
        (PEERS, "link add dum0 type dummy", "network namespace ecu1: No such file or directory"),
    ],
    ids=["other-kind", "no-pair", "no-namespace"],
)
def test_nothing_is_made_when_something_is_in_the_way(rig, netns, text, made, reason):
    netns("ns1")
    ip(made)
    before = set(links())
    assert reason in rig("up", text, status=1)
    assert set(links()) == before


def test_what_was_made_goes_again_when_the_rest_cannot_be(rig, netns):
    netns("ecu1", "ecu2")
    subprocess.run(["ip", "-n", "ecu2", "link", "add", "can0", "type", "vcan"], check=True)
    error = rig("up", PEERS, status=1)
    assert "cannot make v1: can0 in ecu2: " in error, error
    assert set(links()) == {"lo"}
    assert set(links("ecu1")) == {"lo"}


def test_a_changed_peer_makes_the_pair_anew(rig, netns):
    netns("ecu1", "ecu2")
    rig("up", PEERS)
    index = links()["v2"]["ifindex"]
    assert rig("up", PEERS.replace("can0, netns: ecu1", "can7, netns: ecu1")) == (
        "made v0: can7 in ecu1\n"
    )
    assert set(links("ecu1")) == {"lo", "can7"}
    assert links()["v2"]["ifindex"] == index
    assert rig("up", PAIR) == "made v0\nmade v1\n", "peers that are no more"
    assert kind(links()["v0"]) == "vcan"


def test_down_knows_what_it_made_whatever_became_of_the_file(rig, tmp_path):
    rig("up", PAIR)
    rig.file.write_text("no configuration\n")
    assert rig("down") == "removed v0\nremoved v1\n"
    rig("up", PAIR)
    rig.file.unlink()
    assert rig("down", name="rig.yaml", cwd=tmp_path) == "removed v0\nremoved v1\n"


def test_down_leaves_what_another_file_made(rig, tmp_path):
    other = tmp_path / "rig.yaml2"
    other.write_text(PAIR.replace("v0", "w0").replace("v1", "w1"))
    rig("up", PAIR)
    rig("up", name=other)
    rig("down")
    assert set(links()) == {"lo", "w0", "w1"}
    rig("down", name=other)


@pytest.mark.parametrize("name", ["rig", "other"])
def test_down_leaves_what_a_running_bus_uses(rig, canwired, name):
    """Also one of FILE itself. The others go."""
    rig("up", PAIR + "  - { name: c, port: v2 }\n")
    bus = canwired(PAIR.replace("name: rig", f"name: {name}"))
    done = subprocess.run([CANWIRE, "vcan", "down", rig.file], capture_output=True, text=True,
                          check=False)
    assert (done.returncode, done.stdout) == (1, "removed v2\n")
    assert done.stderr == "".join(
        f"canwire vcan: {port} stays: it is in use by bus {name} of canwired, pid "
        f"{bus.process.pid}: stop it first\n" for port in ("v0", "v1"))
    assert {"v0", "v1"} <= set(links())
    bus.stop()
    assert rig("down") == "removed v0\nremoved v1\n"


def test_who_may_not_is_told(rig):
    def become_nobody():
        os.setgroups([])
        os.setgid(65534)
        os.setuid(65534)

    os.chmod(rig.file.parent.parent, 0o755)  # pytest's, for root alone
    os.chmod(rig.file.parent.parent.parent, 0o755)
    os.chmod(rig.file.parent, 0o755)
    tool = shutil.copy(CANWIRE, rig.file.parent)  # the checkout may be in somebody's own home
    error = rig("up", PAIR, status=1, tool=tool, preexec_fn=become_nobody)
    assert "cannot make v0: Operation not permitted (run it as root)" in error, error
    assert set(links()) == {"lo"}


def test_bad_input_is_refused(rig, tmp_path):
    assert f"{rig.file}:1:" in rig("up", "bus: 1\n", status=1)
    assert "too long" in rig("up", PAIR, status=1, name=deep(tmp_path, PAIR))
    assert "usage" in rig("sideways", PAIR, status=2)
    assert set(links()) == {"lo"}


def deep(folder, text):
    path = folder / ("x" * 200) / "rig.yaml"
    path.parent.mkdir()
    path.write_text(text)
    return path


def test_a_kernel_socket_of_the_namespace_is_its_own(rig, netns):
    """The peer is not in the namespace of the port."""
    netns("ecu1", "ecu2")
    rig("up", PEERS)
    with socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW) as s:
        with pytest.raises(OSError):
            s.bind(("can0",))
