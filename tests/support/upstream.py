# SPDX-License-Identifier: MIT
"""The tests of another project, unmodified: those of python-can, for example.

scripts/venv has unpacked them (tests/sources.txt). Many of them sleep, so a Suite runs several
parts beside each other. `words(part)` are the words before the interpreter of a part: a program
that starts it at a bus of its own, for example.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

from simtool import ROOT, kill_all

PYTHON = ROOT / "build/venv/bin/python"
SOURCES = ROOT / "build/venv/sources"
LIMIT_S = 300  # for what hangs
ATTEMPTS = 5   # of a test that has limits of time itself
# with these, the tests of python-can leave out those with limits of time
CI = {"CI", "CONTINUOUS_INTEGRATION", "GITHUB_ACTIONS", "TRAVIS"}


class Suite:
    def __init__(self, name, folder, words=lambda part: [], attributes=(), plugins=(), **more):
        """more: variables of the environment."""
        self.root, = SOURCES.glob(f"{name}-*/")
        self.folder, self.before = folder, words
        self.words = ["-m", "pytest", "-q", "--tb=short"]
        for plugin in ("no:cacheprovider", "no:xdist", "no:hypothesispytest", "upstream_plugin",
                       *plugins):
            self.words += ["-p", plugin]
        for attribute in attributes:
            self.words += ["--attribute", attribute]
        self.environment = {key: value for key, value in os.environ.items() if key not in CI}
        path = [str(Path(__file__).parent), *filter(None, sys.path)]
        self.environment.update(PYTHONPATH=os.pathsep.join(path), PYTHONDONTWRITEBYTECODE="1",
                                **more)

    def begin(self, part, *words):
        return subprocess.Popen(
            [*self.before(part), str(PYTHON), *self.words, *words], cwd=self.root, text=True,
            env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)

    def collect(self, selection):
        """Returns the names of all tests in files and classes."""
        done = self.begin(0, "--collect-only", *selection)
        output = done.communicate(timeout=LIMIT_S)[0]
        assert done.returncode == 0, output
        return [line for line in output.splitlines() if "::" in line]

    def run(self, names, parts=1):
        """Returns {name: (outcome, text)}."""
        files = [self.folder / f"outcomes-{part}.json" for part in range(parts)]
        processes = []
        try:
            for part, file in enumerate(files):
                file.unlink(missing_ok=True)
                processes.append(self.begin(part, "--outcomes", str(file), *names[part::parts]))
            outcomes = {}
            for process, file in zip(processes, files):
                output = process.communicate(timeout=LIMIT_S)[0]
                assert file.exists(), output
                outcomes.update(json.loads(file.read_text()))
        finally:
            kill_all(processes)
        assert sorted(outcomes) == sorted(names)
        return outcomes

    def results(self, selection, without=(), timed=(), parts=1):
        """Runs all tests but some; those with limits of time again while they fail. Returns
        {outcome: names}, and the texts of those that failed."""
        every = self.collect(selection)
        unknown = [name for name in (*without, *timed) if not any(name in one for one in every)]
        assert not unknown, f"no tests of these names: {unknown}"
        outcomes = self.run([one for one in every if not any(name in one for name in without)],
                            parts)
        for _ in range(ATTEMPTS - 1):
            again = [one for one, (outcome, _) in outcomes.items()
                     if outcome == "failed" and any(name in one for name in timed)]
            if again:
                outcomes.update(self.run(again))
        found = {word: sorted(one for one, (outcome, _) in outcomes.items() if outcome == word)
                 for word in ("passed", "skipped", "failed")}
        return found, "\n".join(text for outcome, text in outcomes.values() if outcome == "failed")
