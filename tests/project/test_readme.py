# SPDX-License-Identifier: MIT
"""README.md and the pages beside it are true: their YAML, output, links and length."""

import os
import pathlib
import re
import subprocess

import pytest

from readme import first_block

ROOT = pathlib.Path(__file__).resolve().parents[2]
CANWIRE = pathlib.Path(os.environ.get("CANWIRE", ROOT / "build/release/canwire"))
README = (ROOT / "README.md").read_text(encoding="utf-8")
PAGES = ["README.md", "CONTRIBUTING.md", "lib/DESIGN.md", "tests/README.md",
         *sorted(f"daemon/man/{path.name}" for path in (ROOT / "daemon/man").iterdir())]
LINES_MAX = 150
CHANGES_MAX = 100  # lines of a version in CHANGELOG.md
COLUMNS_MAX = 100


def text_of(page):
    return (ROOT / page).read_text(encoding="utf-8")


def snippets():
    """Returns (page, YAML) of each configuration on a page, but for parts of one."""
    for page in PAGES:
        for yaml in re.findall(r"^```yaml\n(.*?)^```", text_of(page), re.MULTILINE | re.DOTALL):
            if yaml.startswith("bus:"):
                yield page, yaml


def run(*command, **more):
    return subprocess.run(command, capture_output=True, text=True, check=False, **more)


def test_the_configurations_are_good(write):
    assert len(list(snippets())) > 10
    for page, yaml in snippets():
        done = run(CANWIRE, "check", write(yaml))
        assert done.returncode == 0, (page, done.stderr)


def test_the_simulation_draws_as_is_shown(tmp_path):
    """The three lines, with other options."""
    new, old = re.search(r"`(--svg [^`]*)` in\s+place of `([^`]*)`", README).groups()
    script = first_block("README.md").replace(old, new)
    path = f"{CANWIRE.parent}:{os.environ['PATH']}"
    done = run("bash", "-c", script, cwd=tmp_path, env={**os.environ, "PATH": path})
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    drawn = (tmp_path / "bit.svg").read_text(encoding="utf-8")
    assert drawn == text_of("config/picture/one-bad-bit.svg")


def test_the_bits_are_those_that_are_shown():
    shown = re.search(r"^    \$ canwire (bits .*)\n((?:    .+\n)+)    \.\.\.\n",
                      text_of("daemon/man/canwire.1.md"), re.MULTILINE)
    lines = run(CANWIRE, *shown[1].split()).stdout.splitlines()
    assert [line for line in shown[2].splitlines() if line[4:] not in lines] == []


def leads(page, name, anchor=None):
    """Returns True when there is such a file, with such a heading."""
    path = (ROOT / page).parent / name if name else ROOT / page
    if anchor is None or not path.exists():
        return path.exists()
    headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.MULTILINE)
    return anchor in [re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings]


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\(([^):]+)\)", text_of(page))
    assert [link for link in links if not leads(page, *link.split("#"))] == []


def test_all_files_of_the_library_are_in_its_design():
    design = text_of("lib/DESIGN.md")
    names = {path.stem for path in (ROOT / "lib").glob("*/*.c")}
    assert len(names) > 40
    assert [name for name in sorted(names) if not re.search(rf"[`| ]{name}[` ]", design)] == []


def test_all_folders_and_functions_of_the_design_are_there():
    design = text_of("lib/DESIGN.md")
    folders = {f"daemon/{path.name}" for path in (ROOT / "daemon").iterdir() if path.is_dir()}
    assert [name for name in sorted(folders) if f"`{name}`" not in design] == []
    source = "\n".join(path.read_text(encoding="utf-8") for folder in ("lib", "daemon")
                       for path in (ROOT / folder).rglob("*.[ch]"))
    functions = set(re.findall(r"`([a-z_]+)\(\)`", design))
    assert len(functions) > 40
    external = {"recvmmsg", "sendmmsg"}
    assert [f for f in sorted(functions - external) if not re.search(rf"\b{f}\(", source)] == []


def test_it_is_short():
    assert len(README.splitlines()) <= LINES_MAX


def test_the_two_commands_are_named():
    targets = re.findall(r"^([a-z]+):.* ## ", text_of("Makefile"), re.MULTILINE)
    assert {"demo", "test"} <= set(targets) & set(re.findall(r"`make ([a-z]+)`", README))


def test_changes_of_a_version_are_few_and_short():
    versions = re.split(r"^## ", text_of("CHANGELOG.md"), flags=re.MULTILINE)[1:]
    for name, *lines in map(str.splitlines, versions):
        assert len(lines) < CHANGES_MAX, name
        assert [line for line in lines if len(line) > COLUMNS_MAX] == [], name


@pytest.mark.parametrize("page", PAGES)
def test_lines_of_prose_are_short(page):
    prose = re.sub(r"^```.*?^```$", "", text_of(page), flags=re.MULTILINE | re.DOTALL)
    wide = [line for line in prose.splitlines() if len(line) > COLUMNS_MAX
            and not line.startswith(("|", "    ", "!["))]
    assert wide == []
