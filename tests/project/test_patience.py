# SPDX-License-Identifier: MIT
"""No test depends on how busy the machine is.

A test that waits for an event checks for it again and again, with a limit that is no measure of
speed. A stream is read to its end. An exception has a word on its line. `# no wait: ...` marks a
pause whose length does not matter. `# whole: ...` marks data that one call reads as a whole. `#
poll: ...` marks a short limit within a loop.
"""

import ast
import re
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]
# the times in tests/python are those of a bus
FILES = [file for file in sorted(TESTS.rglob("*.py"))
         if not {"bench", "python"} & set(file.parts[len(TESTS.parts):])]
LEAST_S = 30
POLL_S = 0.5  # a pause within a loop that looks for something
LIMITS = {"timeout", "timeout_s", "patience_s"}
LOOPS = (ast.While, ast.For, ast.comprehension, ast.GeneratorExp, ast.ListComp)


def numbers(tree):
    """Returns the names of a module that stand for a number."""
    return {node.targets[0].id: node.value.value for node in tree.body
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, (int, float))}


def value_of(node, names):
    """Returns a number, or None for a value that is only known at run time."""
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        return None if isinstance(node.value, bool) else node.value
    if isinstance(node, ast.Name):
        return names.get(node.id)
    return None


class Finder(ast.NodeVisitor):
    """Finds all places of a file that may depend on time."""

    def __init__(self, text):
        self.lines, self.names = text.splitlines(), {}
        self.loops, self.found = 0, []

    def visit(self, node):
        inside = isinstance(node, LOOPS)
        self.loops += inside
        super().visit(node)
        self.loops -= inside

    def visit_Module(self, node):
        self.names = numbers(node)
        for name, value in self.names.items():
            if re.search("PATIENCE|TIMEOUT", name) and value < LEAST_S:
                self.found.append((1, f"{name} = {value} s", ""))
        self.generic_visit(node)

    def visit_Call(self, node):
        function = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(
            node.func, "id", "")
        first = value_of(node.args[0], self.names) if node.args else None
        self.look_at_limits(node, function, first)
        if function == "sleep" and not (self.loops and first is not None and first <= POLL_S):
            self.note(node, "a pause", "no wait")
        if function in ("recv", "recv_into", "recvfrom") and not self.loops:
            self.note(node, "one piece of a stream", "whole")
        self.generic_visit(node)

    def look_at_limits(self, node, function, first):
        limits = [value_of(k.value, self.names) for k in node.keywords if k.arg in LIMITS]
        if function in ("settimeout", "wait", "join"):
            limits.append(first)
        if function == "select" and len(node.args) == 4:
            limits.append(value_of(node.args[3], self.names))
        for limit in limits:
            if limit is not None and 0 < limit < LEAST_S:
                self.note(node, f"a limit of {limit} s",
                          "no wait" if function == "wait" and not self.loops else "poll")

    def note(self, node, what, word):
        lines = self.lines[node.lineno - 1:node.end_lineno]
        if not any(f"# {word}: " in line for line in lines):
            self.found.append((node.lineno, what, f"# {word}: ..."))


def find(text):
    finder = Finder(text)
    finder.visit(ast.parse(text))
    return finder.found


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(TESTS)))
def test_of_python(file):
    found = find(file.read_text(encoding="utf-8"))
    assert not found, "\n".join(f"{file}:{line}: {what}; wait for something, or say {word}"
                                for line, what, word in found)


C_PAUSE = re.compile(r"\b(u?sleep|nanosleep|clock_nanosleep)\(")


# Not what takes the place of the clock in tests/world.
@pytest.mark.parametrize("file", [file for file in sorted(TESTS.rglob("*.c"))
                                  if "world" not in file.parts],
                         ids=lambda file: str(file.relative_to(TESTS)))
def test_of_c(file):
    """A pause is one of a loop (at most twelve lines above), or says why not."""
    lines = file.read_text(encoding="utf-8").splitlines()
    for i, line in enumerate(lines):
        if not C_PAUSE.search(line) or line.lstrip().startswith(("*", "/*")):
            continue
        around = "\n".join(lines[max(0, i - 12):i + 1])
        assert re.search(r"\b(while|for)\b|no wait: ", around), f"{file}:{i + 1}: a pause: {line}"


@pytest.mark.parametrize("text, count", [
    ("time.sleep(1)", 1), ("time.sleep(1)  # no wait: it may be longer", 0),
    ("while not x():\n    time.sleep(0.01)", 0), ("while not x():\n    time.sleep(2)", 1),
    ("s.settimeout(5)", 1), ("s.settimeout(0)", 0), ("s.settimeout(60)", 0),
    ("LIMIT_S = 3\np.wait(timeout=LIMIT_S)", 1), ("p.wait(patience)", 0), ("PATIENCE_S = 5", 1),
    ("a = s.recv(8)", 1), ("while a := s.recv(8):\n    pass", 0),
    ("a = s.recv(8)  # whole: a datagram", 0), ("select.select([a], [], [], 1)", 1),
])
def test_that_it_is_seen(text, count):
    assert len(find(text)) == count
