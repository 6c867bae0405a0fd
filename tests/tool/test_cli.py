# SPDX-License-Identifier: MIT
"""Wrong command lines: a wrong form ends with status 2, a bad value or file with 1.

One table over all subcommands of canwire, and canwired. tests/kernel/test_control.py tests the
refusals of a running bus. Needs no CAN in the kernel.
"""

import contextlib
import fcntl
import json
import os
import pty
import re
import socket
import struct
import subprocess
import termios
import threading
import time

import pytest

from simtool import CANWIRE, CANWIRED, TIMEOUT_S, canwire, run

pytestmark = pytest.mark.kept

GOOD = """
bus: { name: small, bitrate: 500000 }
nodes: [ { name: a, traffic: [ { send: 123# } ] }, { name: b } ]
"""

BUS = "./none.sock"  # no bus listens there

# The least that each subcommand takes; FILE is a good configuration.
COMMANDS = {
    "check": ["FILE"],
    "bits": ["123#"],
    "timing": ["--bitrate", "500000", "--clock", "16MHz"],
    "vcan": ["down", "FILE"],
    "sim": ["FILE"],
    "campaign": ["show", "CAMPAIGN", "0"],
    "analyse": ["FILE"],
    "status": [BUS],
    "watch": [BUS],
    "top": [BUS],
    "record": [BUS, "out.log"],
    "extcap": ["--extcap-interfaces"],
    "faults": [BUS],
    "inject": [BUS, "{}"],
    "clear": [BUS],
    "fire": [BUS, "rule"],
    "restart": [BUS, "node"],
    "set": [BUS, "node", "queue=1"],
    "run": ["--bus", BUS, "--as", "node", "true"],
    "reload": [BUS],
}

# Options with a value: a bad one, and what the message says is allowed.
VALUES = [
    ("sim", "--until", "soon", "10ms"),
    ("sim", "--until", "10", "unit"),
    ("sim", "--from", "1x", "10ms"),
    ("sim", "--to", "-1ms", "10ms"),
    ("sim", "--seed", "-1", "a whole number from 0 to 18446744073709551615"),
    ("sim", "--seeds", "3..1", "expected FIRST..LAST"),
    ("sim", "--jobs", "0", "a whole number from 1 to 256"),
    ("campaign", "--shard", "4/3", "K/N, such as 1/4"),
    ("campaign", "--jobs", "257", "a whole number from 1 to 256"),
    ("campaign", "--only", "x", "the number of a row"),
    ("campaign", "--ftti", "soon", "50ms"),
    ("campaign", "--confidence", "lots", "50% to 99.9999%"),
    ("campaign", "--minimise", "soon", "60s, up to 24h"),
    ("sim", "--until-event", "explosion", "expected [NODE:]EVENT"),
    ("timing", "--bitrate", "999", "a whole number from 1000 to 20000000"),
    ("timing", "--bitrate", "500k", "to 20000000, write 500000"),
    ("timing", "--clock", "quick", "16MHz"),
    ("timing", "--tq", "7", "a whole number from 8 to 25"),
    ("timing", "--sample-point", "100%", "from 10% to 99.9%"),
    ("timing", "--dbitrate", "999", "expected a whole number from 1000 to 20000000"),
    ("timing", "--dsample-point", "100%", "from 10% to 99.9%"),
    ("timing", "--delay", "600", "unit"),
    ("timing", "--length", "40", "40m"),
    ("timing", "--tx-delay", "2bit", "600ns"),
    ("timing", "--rx-delay", "101ms", "up to 100ms"),
    ("timing", "--sjw", "0", "a whole number from 1 to 128"),
    ("timing", "--controller", "sja100", "did you mean sja1000"),
    ("top", "--interval", "soon", "10ms"),
    ("top", "--interval", "99ms", "from 100ms to 60s"),
    ("record", "--format", "mp3", "candump or pcapng"),
    ("record", "--size", "big", "64kB"),
    ("record", "--files", "0", "from 1 to"),
    ("analyse", "--simulate", "soon", "10ms"),
    ("analyse", "--error-every", "0", "more than 0"),
    ("status", "--load", "70", "two percentages"),
    ("status", "--state", "off,none", "bus-off and none"),
    ("status", "--sinks", "bad", "ok, warning or critical"),
    ("status", "--links", "bad", "ok, warning or critical"),
    ("status", "--losses", "bad", "ok, warning or critical"),
    ("analyse", "--error-rate", "lots", "such as 1e-5"),
    ("inject", "--with", "rate", "KEY=VALUE"),
    ("reload", "--pid", "0", "the number of a process"),
    *[(name, "--wait", "soon", "10ms") for name, words in COMMANDS.items() if BUS in words],
    ("run", "--wait", "5bit", "expected a time such as 10s, not bits"),
]

# The options that only `canwire campaign report` has.
OF_REPORT = {"--ftti", "--confidence", "--minimise"}

# Arguments that are no options.
FRAMES = [("123", "#"), ("123##", "one digit of flags"), ("123##1F", "two hexadecimal"),
          ("123##1" + "00" * 65, "at most 64"), ("123#GG", "123#DEADBEEF"), ("800#", "up to 7FF")]
ARGUMENTS = [
    (["vcan", "sideways", "FILE"], "usage: canwire vcan up|down FILE", ""),
    (["set", BUS, "node", "queue"], "queue: ", "expected KEY=VALUE"),
    (["help", "explode"], "unknown command 'explode'", ""),
    (["reload", "--config", "FILE", BUS], "usage: canwire reload", ""),
    (["reload", "--pid", "1", BUS], "usage: canwire reload", ""),
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
    if name not in ("status", "top"):
        assert f"usage: canwire {name}" in call(name, status=2).stderr
    if name not in ("watch", "top", "set", "run"):  # run: the words of the program
        much = call(name, *COMMANDS[name], "more", "more", status=2).stderr
        assert f"usage: canwire {name}" in much


@pytest.mark.parametrize("name, option, value, allowed", VALUES)
def test_a_bad_value_names_its_option_and_what_is_allowed(call, name, option, value, allowed):
    first, words = (["report"], ["rows"]) if option in OF_REPORT else ([], COMMANDS[name])
    error = call(name, *first, option, value, *words, status=1).stderr
    assert error.startswith(f"canwire {name}: {option} {value}: ") and allowed in error
    assert "usage" not in error
    assert f"{option}' requires an argument" in call(name, *first, option, status=2).stderr


@pytest.mark.parametrize("frame, allowed", FRAMES)
def test_a_bad_frame_is_named_with_what_is_allowed(call, frame, allowed):
    error = call("bits", frame, status=1).stderr
    assert error.startswith(f"canwire bits: FRAME {frame}: ") and allowed in error


@pytest.mark.parametrize("words, message, allowed", ARGUMENTS)
def test_a_bad_argument_is_wrong_usage(call, words, message, allowed):
    error = call(*words, status=2).stderr
    assert message in error and allowed in error


def test_every_option_with_a_value_is_in_the_table(call):
    tried = {(name, option) for name, option, _, _ in VALUES}
    files = {"--events", "--log", "--pcapng", "--stats", "--vcd", "--svg", "--junit", "--journal",
             "--config", "--bus", "--as", "--interface", "--extcap-interface", "--fifo",
             "--extcap-capture-filter", "--extcap-version", "--out", "--work", "--campaign",
             "--json", "--html", "--scenarios"}  # or names
    for name in COMMANDS:
        for line in call(name, "--help", status=0).stdout.splitlines():
            option = re.match(r" +(--[a-z-]+) \[?[A-Z]", line)
            assert not option or option[1] in files or (name, option[1]) in tried, line


@pytest.mark.parametrize("words", [["check", "FILE"], ["sim", "FILE"], ["vcan", "up", "FILE"],
                                   ["reload", "--config", "FILE"]])
def test_a_bad_file_is_status_one_and_has_its_place(words, write, call):
    write(GOOD.replace("bitrate", "bitrat"))
    error = call(*words, status=1).stderr
    assert "/bus.yaml:2:" in error and "bitrat" in error and "usage" not in error


def test_interfaces_of_no_file_are_not_removed_in_silence(call):
    assert call("vcan", "down", "none.yaml", status=1).stderr == (
        "canwire vcan: none.yaml: there is no such file, and no interface of it either\n")
    assert call("vcan", "down", "FILE", status=0).stdout.startswith("no interface of ")


@pytest.mark.parametrize("name", [n for n, w in COMMANDS.items() if w[0] == BUS])
def test_a_bus_that_is_not_there_is_status_one(call, name):
    error = call(name, "--wait", "0", *COMMANDS[name], status=1).stderr
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


# ---- The tool itself -----------------------------------------------------------------------------


@pytest.mark.parametrize("words", [["chekc"], ["help", "chekc"]])
def test_a_command_that_was_probably_meant(words):
    assert canwire(*words, status=2).stderr == \
        "canwire: unknown command 'chekc', did you mean 'check'?\n"


@pytest.mark.parametrize("name", COMMANDS)
def test_help_of_a_command_has_two_ways(call, name):
    assert call("help", name, status=0).stdout == call(name, "--help", status=0).stdout


def test_usage_of_the_tool():
    whole = canwire("--help").stdout
    assert canwire("help").stdout == canwire("-h").stdout == whole
    assert canwire(status=2).stderr == whole
    assert canwire("help", "bits", "sim", status=2).stderr == "usage: canwire help [COMMAND]\n"
    version = canwire("--version").stdout
    assert re.fullmatch(r"canwire \d+\.\d+\.\d+\n", version) and canwire("-V").stdout == version
    assert run(CANWIRED, "--version").stdout == version.replace("canwire", "canwired")


@pytest.mark.parametrize("words", [["bits", "123#"], ["check", "FILE"], ["sim", "FILE"],
                                   ["--help"]])
def test_output_that_cannot_be_written_is_no_success(write, words):
    words = [CANWIRE, *(str(write(GOOD)) if w == "FILE" else w for w in words)]
    with open("/dev/full", "w", encoding="ascii") as full:
        result = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False,
                                timeout=TIMEOUT_S)
    assert result.returncode == 1
    assert result.stderr == "canwire: standard output: No space left on device\n"


# ---- canwire bits --------------------------------------------------------------------------------


def test_letters_of_options_may_stand_together():
    error = canwire("bits", "-rx", "123#", status=2).stderr
    assert error.startswith("canwire bits: wrong option -x\n")
    assert canwire("bits", "-r", "123#").stdout == canwire("bits", "123#", "--raw").stdout


def on_terminal(*words, columns, **environment):
    """Returns the output of canwire on a terminal of that width."""
    outside, inside = pty.openpty()
    fcntl.ioctl(inside, termios.TIOCSWINSZ, struct.pack("4H", 24, columns, 0, 0))
    environment = {k: v for k, v in os.environ.items()
                   if k not in ("COLUMNS", "NO_COLOR", "TERM")} | environment
    with subprocess.Popen([CANWIRE, *words], stdout=inside, env=environment) as process:
        os.close(inside)
        text = b""
        with open(outside, "rb", buffering=0) as terminal:
            try:
                while more := terminal.read(4096):
                    text += more
            except OSError:
                pass  # the terminal has gone with its last program
        assert process.wait(TIMEOUT_S) == 0
    return text.decode().replace("\r\n", "\n")


FRAME = "123#1122334455667788"


def rows_wide(text):
    """Columns of the widest line of bits, without colours."""
    text = re.sub("\033\\[[0-9;]*m", "", text)
    return max(len(line) for line in text.splitlines()
               if line.startswith(("field", "bit", "level", "stuff", "hex")))


@pytest.mark.parametrize("columns, environment, least, most", [
    (60, {}, 30, 60), (150, {}, 100, 150), (60, {"COLUMNS": "100"}, 60, 100),
    (60, {"COLUMNS": "wide"}, 30, 60), (0, {}, 60, 80), (5, {}, 6, 60)])
def test_rows_are_as_wide_as_the_terminal(columns, environment, least, most):
    width = rows_wide(on_terminal("bits", FRAME, columns=columns, **environment))
    assert least < width <= most


@pytest.mark.parametrize("environment, coloured", [
    ({}, True), ({"TERM": "xterm"}, True), ({"TERM": "dumb"}, False), ({"NO_COLOR": "1"}, False),
    ({"NO_COLOR": ""}, True)])
def test_colours_are_for_terminals_that_want_them(environment, coloured):
    assert ("\033[" in on_terminal("bits", FRAME, columns=80, **environment)) == coloured
    assert "\033" not in canwire("bits", FRAME).stdout


# ---- A bus that does not answer as it should -----------------------------------------------------


@pytest.fixture(name="odd_bus")
def fixture_odd_bus(tmp_path):
    """odd_bus(ANSWER) listens at ./odd.sock, takes one request and answers with that."""
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(tmp_path / "odd.sock"))
    listener.listen()
    threads = []

    def start(answer):
        def serve():
            client, _ = listener.accept()
            with client:
                client.makefile("rb").readline()
                with contextlib.suppress(ConnectionError):  # it has heard enough
                    for part in [answer] if isinstance(answer, bytes) else answer:
                        client.sendall(part)

        threads.append(threading.Thread(target=serve))
        threads[-1].start()

    yield start
    for thread in threads:
        thread.join(TIMEOUT_S)
    listener.close()


MUCH = b"a" * (17 << 20)


def now_and_then():
    """Yields a byte again and again, until nobody reads it, and no end of a line."""
    while True:
        yield b"a"
        time.sleep(0.05)


@pytest.mark.parametrize("words, message", [
    (["top", "--once"], "it does not answer"), (["status"], "what it answers is too long")])
def test_an_answer_has_limits_of_time_and_of_size(odd_bus, tmp_path, words, message):
    odd_bus(now_and_then() if "--once" in words else MUCH)
    assert message in canwire(*words, "./odd.sock", status=1, cwd=tmp_path).stderr


def test_an_event_has_a_limit_of_size(odd_bus, tmp_path):
    odd_bus([b'{"ok":true}\n', MUCH])
    told = canwire("watch", "./odd.sock", status=1, cwd=tmp_path).stderr
    assert "it cannot be read any more: Message too long" in told


@pytest.mark.parametrize("status", ["null", "[]", "7"])
def test_an_answer_without_a_status_is_told(odd_bus, tmp_path, status):
    odd_bus(f'{{"ok":true,"status":{status}}}\n'.encode())
    told = canwire("status", "./odd.sock", status=1, cwd=tmp_path)
    assert "what it answers has no status" in told.stderr and told.stdout == ""


@pytest.mark.parametrize("answer, message", [
    (b"", "it ended the connection"),
    (b"hello\n", "what it answers is no JSON object: "),
    (b"[1]\n", "what it answers is no JSON object\n"),
    (b'{"ok": false}\n', "refused without a reason"),
    (b'{"ok": false, "error": "not today"}\n', "not today"),
    (b'{"ok": false, "errors": ["f.yaml:1:2: no", "f.yaml:3:4: never"]}\n',
     "f.yaml:1:2: no\nf.yaml:3:4: never\n"),
])
@pytest.mark.parametrize("words", [["status"], ["faults"], ["clear"], ["watch"], ["reload"]])
def test_a_bus_that_answers_something_else(odd_bus, tmp_path, words, answer, message):
    odd_bus(answer)
    error = canwire(*words, "./odd.sock", status=1, cwd=tmp_path).stderr
    assert message in error
    start = "f.yaml" if message.startswith("f.yaml") else "canwire: bus ./odd.sock: "
    assert error.startswith(start)



@pytest.mark.parametrize("words, rules, told", [
    ([], [], "0 rules cleared\n"),
    ([], ["one"], "1 rule cleared\n"),
    (["--injected"], ["one", "two"], "2 rules cleared\n"),
    (["one"], ["one"], ""),
])
def test_clear_says_how_many_rules_there_were(odd_bus, tmp_path, words, rules, told):
    odd_bus(json.dumps({"ok": True, "rules": rules}).encode() + b"\n")
    assert canwire("clear", "./odd.sock", *words, cwd=tmp_path).stdout == told


@pytest.mark.parametrize("bus, message", [
    ("./odd.sock", "nobody listens at ./odd.sock (is canwired running?)"),
    ("./" + "x" * 108, "the path of its socket is too long"),
    ("nosuch", "no such bus (is canwired@nosuch running?)"),
    ("./bus.yaml/x", "./bus.yaml/x: Not a directory"),
])
def test_why_a_bus_cannot_be_reached(call, tmp_path, bus, message):
    with socket.socket(socket.AF_UNIX) as gone:
        gone.bind(str(tmp_path / "odd.sock"))
    assert call("status", bus, "--wait", "0", status=1).stderr == f"canwire: bus {bus}: {message}\n"


def test_the_buses_that_there_are_are_named(tmp_path):
    """A bus may have another name than its file, its unit or its rig. These do not say theirs."""
    env = os.environ | {"CANWIRE_RUN": str(tmp_path)}
    with contextlib.ExitStack() as stack:
        for name in ("powertrain", "body", "gone"):
            one = stack.enter_context(socket.socket(socket.AF_UNIX))
            one.bind(str(tmp_path / f"{name}.sock"))
            if name != "gone":
                one.listen()
        for words in (["status", "engine"], ["restart", "engine", "a"], ["watch", "engine"]):
            at_once = [] if words[0] == "restart" else ["--wait", "0"]
            result = subprocess.run([CANWIRE, *words, *at_once], env=env, capture_output=True,
                                    text=True, timeout=TIMEOUT_S, check=False)
            assert (result.returncode, result.stderr) == (
                1, f"canwire: bus engine: not found; those in {tmp_path}: body, powertrain; it may "
                   "be one that does not answer: body, powertrain\n")


def test_no_bus_at_all(tmp_path):
    result = subprocess.run([CANWIRE, "status"], env=os.environ | {"CANWIRE_RUN": str(tmp_path)},
                            capture_output=True, text=True, timeout=TIMEOUT_S, check=False)
    assert (result.returncode, result.stderr) == (0, f"canwire: no bus in {tmp_path}\n")


CONTROLS = "\x1b[31m\x9b\x7f"  # characters that a terminal obeys


@pytest.mark.parametrize("words", [
    ["sim", "FILE", "--log", "/nowhere/" + CONTROLS], ["sim", "FILE", "--" + CONTROLS],
    ["bits", "1" + CONTROLS], [CONTROLS], ["check", CONTROLS], ["status", "./" + CONTROLS]],
    ids=["output", "option", "frame", "command", "file", "bus"])
def test_no_message_has_control_characters(words, write):
    path = str(write("bus: { bitrate: 500000 }\nnodes: [ { name: a } ]\n"))
    result = subprocess.run([CANWIRE, *[path if w == "FILE" else w for w in words]],
                            capture_output=True, timeout=TIMEOUT_S, check=False)
    assert result.returncode != 0
    text = result.stderr.decode()
    assert text and not any(c in text for c in CONTROLS if not c.isprintable()), repr(text)


@pytest.mark.parametrize("text", [
    'expect: [ { name: "a\\x9Bb", frame: 123 } ]', 'record: [ { file: "r\\x9B.log" } ]',
    'control: "c\\eb.sock"'])
def test_no_text_of_a_configuration_has_control_characters(text, write):
    path = write("bus: { bitrate: 500000 }\nnodes: [ { name: a } ]\n" + text + "\n")
    assert "control characters" in canwire("check", path, status=1).stderr
