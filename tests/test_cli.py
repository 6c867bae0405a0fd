# SPDX-License-Identifier: MIT
"""Wrong command lines: what is wrong on them ends with status 2, what is wrong in files with 1.

One table over all subcommands of canwire, and canwired. What a bus that runs refuses is tested with
one, in tests/kernel/test_control.py. Needs no CAN in the kernel.
"""

import re

import pytest

from simtool import CANWIRED, canwire, run

GOOD = """
bus: { name: small, bitrate: 500000 }
nodes: [ { name: a, traffic: [ { send: 123# } ] }, { name: b } ]
"""

BUS = "./none.sock"  # nobody listens there

# The least that each subcommand takes; FILE is a good configuration.
COMMANDS = {
    "check": ["FILE"],
    "bits": ["123#"],
    "vcan": ["down", "FILE"],
    "sim": ["FILE"],
    "status": [BUS],
    "watch": [BUS],
    "record": [BUS, "out.log"],
    "faults": [BUS],
    "inject": [BUS, "{}"],
    "clear": [BUS],
    "fire": [BUS, "rule"],
    "restart": [BUS, "node"],
    "set": [BUS, "node", "queue=1"],
    "reload": [BUS],
}

# Options with a value: a bad one, and what the message says is allowed.
VALUES = [
    ("sim", "--until", "soon", "10ms"),
    ("sim", "--until", "10", "unit"),
    ("sim", "--from", "1x", "10ms"),
    ("sim", "--to", "-1ms", "10ms"),
    ("sim", "--seed", "-1", "a whole number from 0 to 18446744073709551615"),
    ("sim", "--until-event", "explosion", "expected [NODE:]EVENT"),
    ("record", "--format", "mp3", "candump or pcapng"),
    ("record", "--size", "big", "64kB"),
    ("record", "--files", "0", "from 1 to"),
    ("inject", "--with", "rate", "KEY=VALUE"),
]

# Arguments that are no options.
ARGUMENTS = [
    (["bits", "123"], "FRAME 123: ", "#"),
    (["bits", "123#GG"], "FRAME 123#GG: ", "123#DEADBEEF"),
    (["vcan", "sideways", "FILE"], "usage: canwire vcan up|down FILE", ""),
    (["set", BUS, "node", "queue"], "queue: ", "expected KEY=VALUE"),
    (["help", "explode"], "unknown command 'explode'", ""),
    (["explode"], "unknown command 'explode'", ""),
]


@pytest.fixture(name="call")
def fixture_call(write, tmp_path):
    path = write(GOOD)

    def call(*arguments, status):
        words = [str(path) if a == "FILE" else a for a in arguments]
        return canwire(*words, status=status, cwd=tmp_path)

    return call


def test_the_table_has_all_subcommands():
    told = canwire("--help").stdout.partition("commands:\n")[2].partition("\n\n")[0]
    assert [line.split()[0] for line in told.splitlines()] == list(COMMANDS)


@pytest.mark.parametrize("name", COMMANDS)
def test_an_unknown_option_is_named(call, name):
    error = call(name, "--explode", *COMMANDS[name], status=2).stderr
    assert error.startswith(f"canwire {name}: ") and "--explode" in error
    assert f"usage: canwire {name}" in error


@pytest.mark.parametrize("name", COMMANDS)
def test_too_much_or_too_little_is_wrong_usage(call, name):
    if name not in ("status",):
        assert f"usage: canwire {name}" in call(name, status=2).stderr
    if name not in ("watch", "set"):
        much = call(name, *COMMANDS[name], "more", "more", status=2).stderr
        assert f"usage: canwire {name}" in much


@pytest.mark.parametrize("name, option, value, allowed", VALUES)
def test_a_bad_value_names_its_option_and_what_is_allowed(call, name, option, value, allowed):
    error = call(name, option, value, *COMMANDS[name], status=2).stderr
    assert error.startswith(f"canwire {name}: {option} {value}: ") and allowed in error
    assert f"{option}' requires an argument" in call(name, option, status=2).stderr


@pytest.mark.parametrize("words, message, allowed", ARGUMENTS)
def test_a_bad_argument_is_wrong_usage(call, words, message, allowed):
    error = call(*words, status=2).stderr
    assert message in error and allowed in error


def test_every_option_with_a_value_is_in_the_table(call):
    tried = {(name, option) for name, option, _, _ in VALUES}
    files = {"--events", "--log", "--pcapng", "--stats", "--vcd", "--svg", "--junit", "--journal"}
    for name in COMMANDS:
        for line in call(name, "--help", status=0).stdout.splitlines():
            option = re.match(r" +(--[a-z-]+) \[?[A-Z]", line)
            assert not option or option[1] in files or (name, option[1]) in tried, line


@pytest.mark.parametrize("words", [["check", "FILE"], ["sim", "FILE"], ["vcan", "up", "FILE"]])
def test_a_bad_file_is_status_one_and_has_its_place(words, write, call):
    write(GOOD.replace("bitrate", "bitrat"))
    error = call(*words, status=1).stderr
    assert "/bus.yaml:2:" in error and "bitrat" in error and "usage" not in error


@pytest.mark.parametrize("name", [n for n, w in COMMANDS.items() if w[0] == BUS])
def test_a_bus_that_is_not_there_is_status_one(call, name):
    error = call(name, *COMMANDS[name], status=1).stderr
    assert error.startswith("canwire: bus ./none.sock: ") and "usage" not in error


@pytest.mark.parametrize("name", COMMANDS)
def test_help_tells_the_exit_status(call, name):
    told = " ".join(call(name, "--help", status=0).stdout.split())
    assert "Exit status: 0" in told and "2 wrong usage" in told


@pytest.mark.parametrize("words, status, message", [
    ([], 2, "usage: canwired"), (["-c"], 2, "requires an argument -- 'c'"),
    (["--explode"], 2, "--explode"), (["-c", "FILE", "more"], 2, "usage: canwired"),
    (["-c", "none.yaml"], 1, "none.yaml: No such file"), (["--help"], 0, "")])
def test_canwired_has_the_same_rule(write, words, status, message):
    path = write(GOOD)
    words = [str(path) if w == "FILE" else w for w in words]
    result = run(CANWIRED, *words, status=status, cwd=path.parent)
    assert message in result.stderr
