# SPDX-License-Identifier: MIT
"""The scripts that developers call: what they look at, and what they leave behind."""

import os
import pathlib
import re
import shutil
import signal
import subprocess
import time

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
PATIENCE_S = 60  # until something that must come counts as missing


def write_script(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/bash\n{text}\n")
    path.chmod(0o755)


def copy_script(name, root):
    (root / "scripts").mkdir(parents=True, exist_ok=True)
    return shutil.copy(ROOT / "scripts" / name, root / "scripts")


# ---- check -----------------------------------------------------------------------------------

LINES, SHELL = "no line of code has more than 100 columns", "shell scripts"


def check(root):
    """Returns the reports of scripts/check about lines and shell scripts, for a nearly empty
    tree."""
    done = subprocess.run([copy_script("check", root), "none.a"], capture_output=True, text=True,
                          check=False, timeout=600)
    assert done.returncode == 1, "the library is not there"
    return {name: (word, done.stdout) for word in ("ok", "FAILED") for name in (LINES, SHELL)
            if f"{word}: {name}\n" in done.stdout}


def test_check_looks_at_files_that_are_not_in_git(tmp_path):
    (tmp_path / "lib").mkdir()
    source = tmp_path / "lib/a.c"
    source.write_text("int a;" + " " * 94 + "\n")
    write_script(tmp_path / "tests/a.sh", "echo hello")
    write_script(tmp_path / "build/b.py", "#" * 200)
    assert {name: word for name, (word, _) in check(tmp_path).items()} == {LINES: "ok", SHELL: "ok"}
    source.write_text("int a;" + " " * 95 + "\n")
    write_script(tmp_path / "tests/a.sh", "cd $1")
    found = check(tmp_path)
    assert found[LINES][0] == "FAILED" and "lib/a.c:1: 101 columns" in found[LINES][1]
    assert found[SHELL][0] == "FAILED" and "In tests/a.sh line 2:" in found[SHELL][1]


# ---- words -----------------------------------------------------------------------------------

LONG = "One two three four five six seven eight nine ten eleven twelve " * 2 + "and one more."


def words(root, name, text):
    """Returns the complaints of scripts/words about one file."""
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    done = subprocess.run([copy_script("words", root), path], capture_output=True, text=True,
                          check=False, timeout=60)
    assert done.returncode == (1 if done.stderr else 0)
    return done.stderr


@pytest.mark.parametrize("name, text, complaint", [
    ("daemon/a.c", f"int a;\n/* {LONG} */\n", "daemon/a.c:2: 27 words: One two"),
    ("daemon/a.c", "/* Whether a node is on the bus. */", 'opens with "Whether"'),
    ("daemon/a.c", "int a; /* what is kept */", 'opens with "what"'),
    ("daemon/a.h", "/* Returns a tick. Where no clock is, 0. */", 'opens with "Where"'),
    ("daemon/a.c", "/* Returns the crowd of a bit. */", '"crowd" is a metaphor'),
    ("tests/a.py", 'def f():\n    """Which node it is."""\n', 'tests/a.py:2: opens with "Which"'),
    ("tests/a.py", "A = 1  # how many there are\n", 'tests/a.py:1: opens with "how"'),
    ("scripts/a", "#!/bin/bash\n# What it makes.\n", 'scripts/a:2: opens with "What"'),
    ("Makefile", "all: ## what there is\n", 'Makefile:1: opens with "what"'),
    ("README.md", f"# Title\n\n* {LONG}\n", "README.md:3: 27 words"),
])
def test_words_finds_comments_that_are_no_plain_sentences(tmp_path, name, text, complaint):
    assert complaint in words(tmp_path, name, text)


@pytest.mark.parametrize("name, text", [
    ("daemon/a.c", "/* Returns true when a node is on the bus. What is that? A node is: */"),
    ("daemon/a.c", 'const char *a = "/* What it is. */";'),
    ("daemon/a.c", f"/* The columns:\n *\n *   name   {LONG}\n */"),
    ("tests/a.py", f'A = "# What it is."\nB = """{LONG}"""\n'),
    ("scripts/a", '#!/bin/bash\necho "# What it is" ${#1}\n'),
    ("README.md", f"What it is:\n\n    {LONG}\n\n| {LONG} |\n"),
    ("config/a.yaml", "# What it is.\n"),
])
def test_words_accepts_plain_sentences_and_all_that_is_no_sentence(tmp_path, name, text):
    assert words(tmp_path, name, text) == ""


# ---- soak ------------------------------------------------------------------------------------

NOTE = 'echo $$ >"$0.new" && mv "$0.new" "$0.pid" && '  # its process, in one go


class Soak:
    """Runs scripts/soak with other programs in place of the guest and of the differential test."""

    def __init__(self, root, guest, differential):
        self.programs = [root / "scripts/guest", root / "differential"]
        for program, text in zip(self.programs, (guest, differential)):
            write_script(program, NOTE + text)
        self.process = subprocess.Popen(  # pylint: disable=consider-using-with
            [copy_script("soak", root), "1s", "7", self.programs[1], "canwired"],
            stdout=subprocess.PIPE, text=True, start_new_session=True,
            # a program that starts these tests in the background may have it ignored
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    def pids(self):
        """Returns the processes of the two, once both run."""
        files = [program.with_name(program.name + ".pid") for program in self.programs]
        deadline = time.monotonic() + PATIENCE_S
        while not all(file.exists() for file in files):
            assert time.monotonic() < deadline, "they do not start"
            time.sleep(0.02)
        return [int(file.read_text()) for file in files]

    def end(self):
        """Its exit status and what it wrote."""
        output = self.process.communicate(timeout=PATIENCE_S)[0]
        return self.process.returncode, output


@pytest.fixture(name="soak")
def fixture_soak(tmp_path):
    soaks = []

    def start(guest, differential):
        soaks.append(Soak(tmp_path, guest, differential))
        return soaks[-1]

    yield start
    for each in soaks:
        try:
            os.killpg(each.process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        each.process.communicate()


def runs(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_soak_that_is_stopped_leaves_nothing_behind(soak, number):
    one = soak("exec sleep 300", "exec sleep 300")
    pids = one.pids()
    if number == signal.SIGINT:  # as a terminal does
        os.killpg(one.process.pid, number)
    else:
        one.process.send_signal(number)
    assert one.end()[0] == 128 + number
    assert [pid for pid in pids if runs(pid)] == []


@pytest.mark.parametrize("guest, differential, status", [(0, 0, 0), (1, 0, 1), (0, 1, 1)])
def test_a_soak_fails_when_one_of_the_two_fails(soak, guest, differential, status):
    found = soak(f"exit {guest}", f'echo "the rest: $*"; exit {differential}').end()
    assert found[0] == status
    assert "the rest: --bits 1666666 --seed 700000" in found[1]


# ---- test ------------------------------------------------------------------------------------

CMOCKA = 'echo "[  PASSED  ] 3 test(s)."'
PYTEST = 'echo "2 passed, 1 skipped in 1.23s"'


class AllTests:
    """Runs scripts/test with programs in place of make, Python and the guest. Each prints the
    output of its framework, and does as ordered."""

    def __init__(self, root, *words, make="true", python="true", guest="true"):
        self.root, self.log = root, root / "build/test.log"
        folder = root / "bin"
        write_script(root / "scripts/venv", "true")
        write_script(folder / "make", f'case "$*" in *" test-unit") {CMOCKA} ;; esac; {make}')
        write_script(root / "build/venv/bin/python", f'[ "$1" != -m ] || {PYTEST}; {python}')
        write_script(root / "scripts/guest", f"{guest}; {PYTEST}")
        self.process = subprocess.Popen(  # pylint: disable=consider-using-with
            # a shell cannot trap a signal that was ignored when it started
            ["env", "--default-signal=INT", copy_script("test", root), *words],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, start_new_session=True,
            env=dict(os.environ, PATH=f"{folder}:{os.environ['PATH']}"))

    def end(self):
        """Its exit status and the lines that it wrote."""
        output = self.process.communicate(timeout=PATIENCE_S)[0]
        return self.process.returncode, output.splitlines()


@pytest.fixture(name="all_tests")
def fixture_all_tests(tmp_path):
    started = []

    def start(*words, **programs):
        started.append(AllTests(tmp_path, *words, **programs))
        return started[-1]

    yield start
    for each in started:
        if each.process.poll() is None:
            each.process.terminate()
        each.process.communicate()


def test_all_tests_are_counted_and_no_lane_writes_into_another(all_tests):
    """The guest goes on until the last stage on the host has finished, and prints all the time."""
    status, lines = all_tests(
        make='case "$*" in *" world "*) echo "4 passed, 0 failed"; touch over ;; esac',
        guest='until [ -e over ]; do echo guest; sleep 0.01; done; echo guest').end()
    stages = [line[5:] for line in lines if line.startswith("==== ")]
    assert stages[-6:] == ["real vcan", "Debian package", "soak, a short one (ASan, UBSan)",
                           "real systemd", "a reboot", "unit and conformance tests (clang)"]
    first, last = lines.index("guest"), lines.index("==== Debian package") - 1
    assert lines[first - 1] == "==== real vcan" and lines[last].startswith("2 passed, 1 skipped")
    assert set(lines[first:last]) == {"guest"}
    table = lines[-len(stages) - 2:-2]
    assert sorted(line.partition(" processors  ")[2] for line in table) == sorted(stages)
    assert lines[-2].endswith(" s  in all")
    # units with three compilers; Python twice on the host, four times in the guest; worlds
    assert (status, lines[-1]) == (0, f"{3 * 3 + 6 * 2 + 4} passed, 0 failed")


@pytest.mark.parametrize("programs, stage", [
    ({"make": 'case "$*" in *CC=clang*test-unit) exit 3 ;; esac'},
     "unit and conformance tests (clang)"),
    ({"python": 'case "$*" in *tests/project) exit 3 ;; esac'},
     "tool, daemon, calls that fail, project"),
    ({"guest": 'case "$*" in *tests/kernel) exit 3 ;; esac'}, "real vcan"),
])
def test_a_stage_that_fails_fails_all_tests(all_tests, programs, stage):
    status, lines = all_tests(**programs).end()
    assert f"==== {stage}: FAILED (status 3)" in lines
    assert [line for line in lines if line.endswith(" processors  " + stage + " (FAILED)")]
    assert status == 1 and lines[-1].endswith(" passed, 1 failed")


def test_a_lane_that_dies_fails_all_tests(all_tests):
    """With its six stages."""
    status, lines = all_tests(guest="kill -KILL $PPID").end()
    assert status == 1 and lines[-1].endswith(" passed, 6 failed")


@pytest.mark.parametrize("words, depth, fewer", [((), "sample", 4), (("deep",), "deep", 1)])
def test_the_deep_tests_take_more(all_tests, tmp_path, words, depth, fewer):
    told = tmp_path / "told"
    assert all_tests(*words, make=f'echo "$TESTS $*" >>{told}').end()[0] == 0
    lines = told.read_text().splitlines()
    assert {line.split()[0] for line in lines} == {depth}
    units = [line for line in lines if line.endswith(" test-unit")]
    assert len(units) == 3 and all(f" FEWER={fewer} " in line for line in units)
    assert sum(line.endswith((" test-arm64", " dist TWICE=yes")) for line in lines) == \
        (2 if depth == "deep" else 0)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_all_tests_that_are_stopped_leave_nothing_behind(all_tests, tmp_path, number):
    one = all_tests(make=f'case "$*" in *check*) {NOTE} exec sleep 300 ;; esac',
                    guest=f"{NOTE} exec sleep 300")
    files = [tmp_path / "bin/make.pid", tmp_path / "scripts/guest.pid"]
    deadline = time.monotonic() + PATIENCE_S
    while not all(file.exists() for file in files):
        assert time.monotonic() < deadline, "they do not start"
        time.sleep(0.02)
    one.process.send_signal(number)
    assert one.end()[0] == 128 + number
    while any(runs(int(file.read_text())) for file in files):  # their new parent reaps them
        assert time.monotonic() < deadline, "they go on"
        time.sleep(0.02)


def test_modules_that_run_together_have_names_of_their_own():  # pytest imports each by its name
    folders = re.search(r"^host_tests=\((.*?)\)", (ROOT / "scripts/test").read_text(),
                        re.M | re.S)[1]
    names = [path.name for folder in folders.split() for path in (ROOT / folder).glob("*.py")]
    assert len(names) > 50
    assert sorted(name for name in set(names) if names.count(name) > 1) == []


# ---- The guest -----------------------------------------------------------------------------------

APPLETS = "sh mount mkdir rm ln cat cp ip insmod switch_root hostname poweroff dmesg grep hwclock"
BUSYBOX = '#include <stdio.h>\nint main(void) { return puts("%s") < 0; }\n'
QEMU = """\
while [ $# -gt 1 ]; do
    case $1 in
    -initrd) cp "$2" "${0%/*}/initrd" ;;
    -kernel) echo "$2" >"${0%/*}/kernel" ;;
    esac
    shift
done
"""


def look_at_initramfs(folder, applets):
    """Runs scripts/guest with a busybox that needs libraries, and a QEMU that boots nothing."""
    (folder / "busybox.c").write_text(BUSYBOX % applets.replace(" ", "\\n"))
    subprocess.run(["cc", "-o", folder / "busybox", folder / "busybox.c"], check=True)
    write_script(folder / "qemu-system-x86_64", QEMU)
    return subprocess.run(
        [ROOT / "scripts/guest", "--", "true"], capture_output=True, text=True, check=False,
        env={**os.environ, "PATH": f"{folder}:{os.environ['PATH']}", "CANWIRE_GUEST": "qemu"})


def test_the_guest_has_the_libraries_of_a_busybox_that_is_not_static(tmp_path):
    done = look_at_initramfs(tmp_path, APPLETS)
    assert "ended without a status" in done.stderr, done.stderr  # of that QEMU
    shutil.rmtree(pathlib.Path((tmp_path / "kernel").read_text().strip()).parent)
    needs = subprocess.run(["ldd", tmp_path / "busybox"], capture_output=True, text=True,
                           check=True).stdout
    paths = re.findall(r"(?:=> |^\t)(/\S+)", needs, re.MULTILINE)
    assert len(paths) >= 2
    with (tmp_path / "initrd").open("rb") as file:
        there = subprocess.run(["cpio", "-t", "--quiet"], stdin=file, capture_output=True,
                               text=True, check=True).stdout.split()
    assert [path for path in paths if path[1:] not in there] == []


def test_a_busybox_that_lacks_something_is_told(tmp_path):
    done = look_at_initramfs(tmp_path, APPLETS.replace("insmod ", ""))
    assert done.returncode == 125
    assert "has no 'insmod': install the package busybox-static" in done.stderr
