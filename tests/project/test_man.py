# SPDX-License-Identifier: MIT
"""--help, man pages and completion agree, and the pages are well formed."""

import json
import os
import pathlib
import re
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
CANWIRE = pathlib.Path(os.environ.get("CANWIRE", ROOT / "build/release/canwire"))
SCHEMA = json.loads((CANWIRE.parent / "schema/canwire.schema.json").read_text())["$defs"]
PAGES = sorted(path.stem for path in (ROOT / "daemon/man").iterdir())
WIDE = "width=500"
KEYS_MAX = 600  # lines of canwire.yaml(5): the keys of a configuration, and links
PARTS = {"traffic-send": "traffic", "traffic-replay": "traffic", "traffic-reply": "traffic",
         "recording": "record", "expectation": "expect"}


def run(*command, **more):
    done = subprocess.run(command, capture_output=True, text=True, check=True, **more)
    return done.stdout


@pytest.fixture(scope="module", name="page")
def fixture_page(tmp_path_factory):
    """page("canwire.1") is the path of a page, made with these programs."""
    folder = tmp_path_factory.mktemp("man")
    for name in PAGES:
        source = ROOT / f"daemon/man/{name}.md"
        (folder / name).write_text(run(ROOT / "scripts/man", "--build", CANWIRE.parent, source))
    return lambda name: folder / name


def commands():
    return re.findall(r"^  ([a-z]+) ", run(CANWIRE, "--help"), re.MULTILINE)


def shown(path):
    """Returns a page as people see it."""
    return re.sub(".\b", "", run("mandoc", "-T", "utf8", "-O", WIDE, path))


def bare(text):
    """Returns a text without blanks, and without the marks of bold."""
    return re.sub(r"[\s`]+", "", text)


def heads(path):
    """Returns the heads of all lists in the source of a page."""
    found = re.findall(r"^\.TP\n(.*)$", path.read_text(), re.MULTILINE)
    return [re.sub(r"\\f.|\\&", "", head).replace("\\-", "-") for head in found]


def test_counters_of_a_campaign_are_those_of_its_rows():
    text = (ROOT / "daemon/campaign/outcome.h").read_text()
    told = (ROOT / "daemon/man/canwire-campaign.7.md").read_text()
    found = {which: re.findall(r"X\((\w+)[,)]", rows) for which, rows in re.findall(
        r"#define OUTCOME_(\w+)_COUNTERS\(X\)((?:[ X].*\n)+)", text)}
    assert f"| {', '.join(f'`{name}`' for name in found['BUS'])} |" in told
    assert f"`{' '.join(found['NODE'])}`" in told.replace("\n", " ")


def test_all_pages_that_are_named_are_there():
    """In documents, comments, messages and units."""
    files = run("git", "ls-files", cwd=ROOT).splitlines() if (ROOT / ".git").exists() else []
    texts = [ROOT / name for name in files if not name.startswith("tests/fuzz/")]
    found = {f"{name}.{section}" for path in texts if path.is_file()
             for name, section in re.findall(r"\b(canwired?(?:[-.][a-z]+)*)\((\d)\)",
                                             path.read_text(errors="replace"))}
    assert (len(found) > 20 or not files) and not list((ROOT / "config").rglob("*.md"))
    assert sorted(found - set(PAGES)) == []


def test_the_configuration_is_a_table_of_keys_and_links(page):
    text = run("man", "-l", page("canwire.yaml.5"), env={**os.environ, "MANWIDTH": "80"})
    assert len(text.splitlines()) <= KEYS_MAX


@pytest.mark.parametrize("name", PAGES)
def test_pages_are_well_formed(name, page):
    environment = dict(os.environ, LC_ALL="C.UTF-8", MANROFFSEQ="", MANWIDTH="80")
    done = subprocess.run(["man", "--warnings", "-E", "UTF-8", "-l", "-Tutf8", "-Z", page(name)],
                          capture_output=True, text=True, check=True, env=environment)
    assert done.stderr == ""
    done = subprocess.run(["mandoc", "-T", "lint", "-W", "warning", page(name)],
                          capture_output=True, text=True, check=False)
    assert (done.stdout + done.stderr, done.returncode) == ("", 0)


@pytest.mark.parametrize("name", PAGES)
def test_no_markup_of_the_source_is_left(name, page):
    text = re.sub(r"^\.nf\n.*?^\.fi\n|\\fB.*?\\fR", "x", page(name).read_text(),
                  flags=re.MULTILINE | re.DOTALL)
    assert not re.findall(r"`|\*\*|\]\(|^@\w+|^\s*\||^#", text, re.MULTILINE)


def help_texts():
    yield "canwired.8", [CANWIRE.parent / "canwired"]
    yield "canwire-usb.8", [CANWIRE.parent / "canwire-usb"]
    yield "canwire.1", [CANWIRE]
    yield from (("canwire.1", [CANWIRE, name]) for name in commands())


def test_all_that_help_says_is_in_the_pages(page):
    texts = {name: bare(shown(page(name))) for name in PAGES}
    count = 0
    for name, command in help_texts():
        text = re.sub("^(usage|commands|exit status): *", "", run(*command, "--help"), flags=re.M)
        for line in filter(str.strip, text.split("\n")):
            # a command of the list is a section, with what it is beneath
            assert bare(line) in texts[name], (name, command, line)
            count += 1
    assert count > 120


def test_the_pages_have_no_option_that_help_has_not(page):
    shared = r"^COMMON TO COMMANDS.*?(?=^[A-Z])"
    text = shown(page("canwire.1"))
    common = re.search(shared, text, re.MULTILINE | re.DOTALL)[0]
    sections = dict(re.findall(r"^   canwire ([a-z]+)\n(.*?)(?=^ {0,3}\S)", text,
                               re.MULTILINE | re.DOTALL))
    assert list(sections) == commands()
    everywhere = []
    for name, section in sections.items():
        options = set(re.findall(r"--[a-z][a-z-]*", section))
        helped = set(re.findall(r"--[a-z][a-z-]*", run(CANWIRE, name, "--help")))
        assert options - {"--help"} <= helped, name
        everywhere.append(helped)
    assert all(any(option in helped for helped in everywhere)
               for option in re.findall(r"--[a-z][a-z-]*", common))


def test_completion_knows_all_commands_and_options():
    script = ROOT / "scripts/completion/canwire.bash"
    ask = f'source {script}; tool={CANWIRE}; echo "$_canwire_commands"; for c in "$@"; do ' \
          'echo "$c" $(_canwire_options "$c"); done'
    lines = run("bash", "-c", ask, "bash", *commands()).splitlines()
    assert sorted(lines[0].split()) == sorted([*commands(), "help"])
    for line in lines[1:]:
        name, *options = line.split()
        told = set(re.findall(r"^ +(?:-\w, )?(--[a-z][a-z-]*)", run(CANWIRE, name, "--help"),
                              re.MULTILINE))
        assert set(options) - {"--help"} == told - {"--help"}, name


def completed(folder, *words):
    """Returns the answers to a Tab behind these words."""
    script = ROOT / "scripts/completion/canwire.bash"
    ask = f"source {script}; COMP_WORDS=(\"$@\"); COMP_CWORD=$(($# - 1)); " \
          "words=($(complete -p \"$1\")); ${words[-2]}; printf '%s\\n' \"${COMPREPLY[@]}\""
    done = subprocess.run(["bash", "-c", ask, "bash", *words], cwd=folder, capture_output=True,
                          text=True, check=True)
    return sorted(done.stdout.split())


@pytest.mark.parametrize("words", [
    ("canwire", "sim"), ("canwire", "check"), ("canwire", "inject", "bus"), ("canwired", "-c"),
    ("canwire-usb",)])
def test_completion_of_configurations(tmp_path, words):
    for name in ("a.yaml", "b.yml", "c.log", "d/e.yaml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert completed(tmp_path, *words, "") == ["a.yaml", "b.yml", "d"]
    assert completed(tmp_path, *words, "c") == ["c.log"]


def test_completion_of_settings(tmp_path, monkeypatch):
    """They are the keys that a rule sets: both come from the table of a node's keys."""
    monkeypatch.setenv("PATH", f"{CANWIRE.parent}:{os.environ['PATH']}")
    words = ("canwire", "set", "bus", "node")
    keys = [f"{key}=" for key in SCHEMA["do-set"]["properties"] if key not in ("set", "ramp")]
    assert completed(tmp_path, *words, "") == sorted(keys)
    for key, values in (("order", "priority fifo"), ("tdc-mode", "off auto manual"),
                        ("loopback", "on off"), ("queue", ""), ("clock", "")):
        assert completed(tmp_path, *words, key, "=", "") == sorted(values.split()), key


@pytest.mark.parametrize("program", ["canwired", "canwire-usb", "canwire-restbus"])
def test_completion_of_the_other_programs(tmp_path, program):
    words = [sys.executable, ROOT / "lib/python/src/canwire/restbus.py"] \
        if program == "canwire-restbus" else [CANWIRE.with_name(program)]
    told = set(re.findall(r"^ +(?:-\w, )?(--[a-z][a-z-]*)", run(*words, "--help"), re.MULTILINE))
    assert set(completed(tmp_path, program, "--")) == told


def keys_of(schema):
    """Returns all keys below, without those of fault rules."""
    name = schema.get("$ref", "").removeprefix("#/$defs/")
    if name in ("rule", "profileUse", "traffic", "recording", "expectation", "nodeDefaults"):
        return
    if name:
        schema = SCHEMA[name]
    for key, value in schema.get("properties", {}).items():
        yield key
        yield from keys_of(value)
    if "items" in schema:
        yield from keys_of(schema["items"])


def test_all_keys_of_a_configuration_are_in_its_page(page):
    told = [head.split(" (")[0] for head in heads(page("canwire.yaml.5"))]
    keys = list(keys_of(SCHEMA["configuration"]))
    assert len(keys) > 25
    assert [key for key in keys if key not in told] == []
    for part, name in PARTS.items():
        told = [head.split(" (")[0] for head in heads(page(f"canwire-{name}.7"))]
        for key in SCHEMA[part]["properties"]:
            assert [h for h in told if re.search(rf"(^|, ){key}(:|$)", h)], key


def test_each_kind_of_action_has_its_place_in_the_page(page):
    told = [head.split(" (")[0] for head in heads(page("canwire-faults.7"))]
    actions = [one["$ref"].removeprefix("#/$defs/do-") for one in SCHEMA["do"]["oneOf"]]
    assert len(actions) > 20
    assert [action for action in actions if action not in told] == []
