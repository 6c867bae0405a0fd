# SPDX-License-Identifier: MIT
"""Injected rules and the end of canwired: a crash loses them and the next start says which; those
that are kept are there again.

CANWIRE and CANWIRED are the programs.
"""

import json
import os
import re
import subprocess

import pytest

from simtool import CANWIRED, answer, canwire, kill_all, stop_canwired
from test_record import wait_until

PATIENCE_S = 60

BUS = """bus: { name: day, bitrate: 500000 }
control: day.sock
nodes: [ { name: load, traffic: [ { send: 123#11, every: 10ms } ] }, { name: dash } ]
"""
RULE = '{{name: {}, when: {{frame: "7FF"}}, do: {{flip: "crc[3]"}}}}'
LOST = r"2 injected rules were lost with the crash at \d{4}-\d\d-\d\d \d\d:\d\d:\d\d: a, b"


class Bus:
    """A canwired that is started again and again in one folder."""

    def __init__(self, folder):
        self.folder, self.log, self.process = folder, folder / "stderr", None
        self.rules, self.bad = folder / "day.sock.rules", folder / "day.sock.rules.bad"
        self.write(BUS)

    def write(self, text):
        (self.folder / "day.yaml").write_text(text)

    def start(self):
        with self.log.open("w") as log:
            self.process = subprocess.Popen([CANWIRED, "-c", "day.yaml"], cwd=self.folder,
                                            stderr=log)
        wait_until(lambda: " bit/s, " in self.log.read_text(), "the bus")

    def crash(self):
        self.process.kill()
        self.process.wait()
        self.start()

    def stop(self):
        return stop_canwired(self.process, self.log)

    def canwire(self, *words, status=0):
        return answer(self.folder, *words, status=status)

    def inject(self, name, *options):
        self.canwire("inject", *options, "./day.sock", RULE.format(name))

    def status(self):
        return json.loads(self.canwire("status", "./day.sock", "--json"))

    def present(self):
        return {f["name"] for f in json.loads(self.canwire("faults", "./day.sock", "--json"))}


@pytest.fixture(name="bus")
def fixture_bus(tmp_path):
    bus = Bus(tmp_path)
    bus.start()
    yield bus
    kill_all([bus.process])


def test_a_crash_loses_injected_rules_and_says_which(bus):
    bus.inject("a")
    bus.inject("b")
    bus.inject("c")
    bus.canwire("clear", "./day.sock", "c")
    bus.crash()
    assert re.search(f"warning: {LOST}\n", bus.log.read_text())
    assert bus.present() == set()
    assert re.search(f"^{LOST}$", bus.canwire("status", "./day.sock"), re.M)
    assert bus.status()["lost_rules"]["rules"] == ["a", "b"]
    first = bus.status()["lost_rules"]
    for _ in range(2):
        bus.crash()
        assert bus.status()["lost_rules"] == first, "nobody has been here"
        assert re.search(f"warning: {LOST}\n", bus.log.read_text())
    bus.inject("a")
    assert "lost_rules" not in bus.status(), "somebody has been here"
    bus.crash()
    assert bus.status()["lost_rules"]["rules"] == ["a"]
    bus.canwire("clear", "./day.sock")
    bus.crash()
    assert "lost_rules" not in bus.status()


def test_who_stops_a_bus_knows_of_the_loss(bus):
    bus.inject("a")
    bus.crash()
    assert bus.status()["lost_rules"]["rules"] == ["a"]
    bus.stop()
    assert not bus.rules.exists()
    bus.start()
    assert "lost_rules" not in bus.status()


def test_rules_that_go_by_request_are_not_lost(bus):
    bus.inject("a")
    bus.canwire("reload", "./day.sock")
    wait_until(lambda: "reload: 1 injected rule is gone" in bus.log.read_text(), "the reload")
    bus.inject("a")
    bus.stop()
    assert not bus.rules.exists()
    bus.start()
    assert "lost with the crash" not in bus.log.read_text()


def test_kept_rules_are_there_again(bus):
    bus.inject("a", "--keep")
    bus.canwire("inject", "--keep", "./day.sock", f"[{RULE.format('b')}, {RULE.format('c')}]")
    bus.canwire("clear", "./day.sock", "b")
    for again in (bus.crash, lambda: (bus.stop(), bus.start())):
        again()
        assert bus.present() == {"a", "c"}
        assert "lost with the crash" not in bus.log.read_text()
    bus.canwire("reload", "./day.sock")
    wait_until(lambda: "configuration reloaded" in bus.log.read_text(), "the reload")
    wait_until(lambda: bus.present() == {"a", "c"}, "the rules")
    assert [(k["rules"], k["refused"]) for k in bus.status()["kept_rules"]] == [
        (["a"], False), (["c"], False)]
    assert "\nkept inject: a\nkept inject: c\n" in bus.canwire("status", "./day.sock")
    bus.canwire("clear", "./day.sock")
    assert not bus.rules.exists()
    bus.crash()
    assert bus.present() == set()


def test_a_text_without_rules_is_not_kept(bus):
    bus.canwire("inject", "--keep", "./day.sock", "{faults: []}", status=1)
    assert not bus.rules.exists() and bus.status()["kept_rules"] == []
    bus.canwire("inject", "./day.sock", "{faults: []}")


def test_rules_are_kept_after_reloads(bus):
    """Each reload frees the configuration, and so the name of the bus."""
    for name in "abc":
        bus.canwire("reload", "./day.sock")
        bus.inject(name, "--keep")
        assert json.loads(bus.rules.read_text())["bus"] == "day"
    bus.crash()
    assert bus.present() == {"a", "b", "c"} and not bus.bad.exists()
    assert not any(entry["refused"] for entry in bus.status()["kept_rules"])


def test_kept_rules_that_the_configuration_refuses_wait_for_another_one(bus):
    rule = '{name: a, do: {noise: 1e-9, at: [dash]}}'
    bus.canwire("inject", "--keep", "./day.sock", rule)
    bus.stop()
    bus.write(BUS.replace("name: dash", "name: board"))
    bus.start()
    assert "error: rules of inject, which are kept, are refused:" in bus.log.read_text()
    assert bus.present() == set()
    why = "inject:1:34: at: there is no node 'dash'; allowed: load, board"
    assert f"kept inject: a (refused: {why})\n" in bus.canwire("status", "./day.sock")
    bus.write(BUS)
    bus.crash()
    assert bus.present() == {"a"}
    bus.write(BUS.replace("name: dash", "name: board"))
    bus.crash()
    bus.canwire("clear", "./day.sock", "a")
    assert bus.status()["kept_rules"] == []
    assert not bus.rules.exists()
    bus.write(BUS)
    bus.crash()
    bus.canwire("inject", "--keep", "./day.sock", rule)
    bus.write(BUS.replace("name: dash", "name: board"))
    bus.crash()
    assert bus.canwire("clear", "./day.sock") == "1 rule cleared\n"
    assert bus.status()["kept_rules"] == []


@pytest.mark.parametrize("content, why", [
    ("{", "it is damaged"),
    ('{"canwire-rules":1,"bus":"day","kept":[],"passing":[],"lost":[7]}', "damaged"),
    ('{"canwire-rules":1,"bus":"day","kept":[7],"passing":[]}', "damaged"),
    ('{"canwire-rules":1,"bus":"night","kept":[],"passing":["a"]}', "it is of another bus")])
def test_a_file_that_is_of_no_use_is_moved_away(bus, content, why):
    bus.stop()
    bus.rules.write_text(content)
    bus.start()
    assert re.search(rf"error: rules .*{why}; .* it is now .*{bus.bad.name}", bus.log.read_text())
    assert bus.bad.read_text() == content
    for _ in range(2):
        told = bus.status()["unread_rules"]
        assert why in told and told.endswith(f"it is now {bus.bad.name}")
        assert f"\n{told}\n" in bus.canwire("status", "./day.sock")
        done = canwire("status", "--check", "./day.sock", status=1, cwd=bus.folder)
        assert told in done.stdout
        bus.crash()
        assert f"warning: {told}\n" in bus.log.read_text()
    bus.inject("a", "--keep")
    assert "unread_rules" not in bus.status()


def test_rules_that_cannot_be_remembered_are_refused(bus):
    bus.rules.with_name("day.sock.rules.new").mkdir()
    told = bus.canwire("inject", "--keep", "./day.sock", RULE.format("a"), status=1)
    assert "cannot be remembered, and are not injected: Is a directory" in told
    assert bus.present() == set()
    bus.inject("b")
    assert "not written: Is a directory" in bus.log.read_text(), "a crash would not tell of it"
    bus.canwire("clear", "./day.sock", "b")
    os.rmdir(bus.rules.with_name("day.sock.rules.new"))
    bus.inject("a", "--keep")


def test_a_clear_that_cannot_be_remembered_says_so(bus):
    """The rules go from the bus. The file still has them, as the next start."""
    bus.inject("a", "--keep")
    bus.inject("b", "--keep")
    blocked = bus.rules.with_name("day.sock.rules.new")
    blocked.mkdir()
    told = bus.canwire("clear", "./day.sock", "b", status=1)
    assert "cleared, but the file of injected rules could not be written" in told
    assert "Is a directory" in told and bus.present() == {"a"}
    os.rmdir(blocked)
    bus.canwire("clear", "./day.sock", "a")
    assert bus.present() == set() and not bus.rules.exists()


def test_the_new_file_is_made_anew(bus, tmp_path):
    """Others may write there: it may be a file of theirs, or hang."""
    theirs, lies = tmp_path / "theirs", bus.rules.with_name("day.sock.rules.new")
    theirs.write_text("theirs")
    os.link(theirs, lies)
    bus.inject("a", "--keep")
    assert theirs.read_text() == "theirs" and '"a"' in bus.rules.read_text()
    os.mkfifo(lies)
    bus.inject("b", "--keep")
    assert '"b"' in bus.rules.read_text()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_a_file_of_another_user_is_moved_away(bus):
    bus.inject("a", "--keep")
    bus.stop()
    os.chown(bus.rules, 65534, -1)
    bus.start()
    assert "it belongs to another user" in bus.log.read_text()
    assert bus.present() == set() and bus.bad.exists()


def test_the_rule_on_the_bus_is_cleared_and_not_a_refused_one(bus):
    text = '{{ name: x, when: {{ frame: "7FF", from: {} }}, do: {{ flip: "crc[3]" }} }}'
    bus.canwire("inject", "--keep", "./day.sock", text.format("dash"))
    bus.write(BUS.replace("name: dash", "name: board"))
    bus.canwire("reload", "./day.sock")
    bus.canwire("inject", "--keep", "./day.sock", text.format("board"))
    bus.canwire("clear", "./day.sock", "x")
    bus.canwire("reload", "./day.sock")
    assert bus.present() == set()


def test_the_note_of_losses_outlives_an_injection_that_fails(bus):
    bus.inject("a")
    bus.crash()
    lost = bus.status()["lost_rules"]
    blocked = bus.rules.with_name("day.sock.rules.new")
    blocked.mkdir()
    bus.canwire("inject", "--keep", "./day.sock", RULE.format("b"), status=1)
    assert bus.status()["lost_rules"] == lost and bus.present() == set()
    os.rmdir(blocked)
    bus.crash()
    assert bus.status()["lost_rules"] == lost
    bus.inject("b", "--keep")
    assert "lost_rules" not in bus.status()
    bus.crash()
    assert "lost_rules" not in bus.status() and bus.present() == {"b"}


LATER = '{{name: {}, when: {{after: {{rule: {}}}, frame: "7FF"}}, do: {{flip: "crc[3]"}}}}'


def test_a_rule_that_another_kept_one_comes_after_stays(bus):
    bus.inject("x", "--keep")
    bus.canwire("inject", "--keep", "./day.sock", LATER.format("z", "x"))
    told = bus.canwire("clear", "./day.sock", "x", status=1)
    assert "rule x: 'z', which is kept, comes after it" in told and "clear 'z' first" in told
    for again in (bus.crash, lambda: (bus.stop(), bus.start())):
        again()
        assert bus.present() == {"x", "z"}
        bus.canwire("clear", "./day.sock", "x", status=1)
    bus.canwire("clear", "./day.sock", "z")
    bus.canwire("clear", "./day.sock", "x")
    bus.inject("y", "--keep")  # it has the index of x
    bus.canwire("clear", "./day.sock", "y")
    assert not bus.rules.exists()


def test_a_rule_of_the_same_text_or_of_no_next_start_does_not_hold_another(bus):
    bus.canwire("inject", "--keep", "./day.sock",
                f"[{RULE.format('x')}, {LATER.format('z', 'x')}]")
    bus.canwire("inject", "./day.sock", LATER.format("passing", "x"))
    bus.canwire("clear", "./day.sock", "x")
    bus.crash()
    assert bus.present() == {"z"}


def test_a_rule_after_one_that_is_not_kept_is_not_kept(bus):
    bus.inject("x")
    told = bus.canwire("inject", "--keep", "./day.sock", LATER.format("z", "x"), status=1)
    assert "'z' comes after 'x', which is not kept" in told
    assert bus.present() == {"x"} and bus.status()["kept_rules"] == []
    bus.canwire("inject", "./day.sock", LATER.format("z", "x"))


def test_the_texts_that_are_kept_have_a_limit(bus):
    """Each save prints all of them, in the time of the bus."""
    for name in "abcde":
        (bus.folder / f"{name}.yaml").write_text(RULE.format(name) + " #" + "x" * 220000)
    for name in "abcd":
        bus.canwire("inject", "--keep", "./day.sock", f"{name}.yaml")
    told = bus.canwire("inject", "--keep", "./day.sock", "e.yaml", status=1)
    assert "keep: the texts that are kept would have 1100" in told
    assert "at most 1048576 are possible" in told and bus.present() == set("abcd")
    bus.canwire("inject", "./day.sock", "e.yaml")
    for name in "ae":
        bus.canwire("clear", "./day.sock", name)
    bus.canwire("inject", "--keep", "./day.sock", "e.yaml")
    bus.crash()
    assert bus.present() == set("bcde")
