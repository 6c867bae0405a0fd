# SPDX-License-Identifier: MIT
"""Profiles are found by their names."""

import json
import shutil
import subprocess

from simtool import CANWIRE, TIMEOUT_S, canwire
from test_journal import NONE

NAMED = """
bus: { bitrate: 500000 }
nodes: [ { name: engine, traffic: [ { send: "001#00" } ] } ]
profiles: [ { file: %s } ]
"""


def test_profiles_are_found_by_name(tmp_path):
    """Beside the file, in profiles/ there, and then in the folder of the installation."""
    program = tmp_path / "bin/canwire"
    program.parent.mkdir()
    shutil.copy(CANWIRE, program)
    path = tmp_path / "etc/bus.yaml"
    path.parent.mkdir()

    def used(name):
        path.write_text(NAMED % name)
        done = subprocess.run([program, "sim", path, "--stats", "-"], capture_output=True,
                              text=True, timeout=TIMEOUT_S, check=False)
        return ([rule["name"] for rule in json.loads(done.stdout)["rules"]]
                if done.returncode == 0 else done.stderr)

    missing = used("wobble")
    assert missing == (f"{path}:4:21: profiles: there is no wobble, neither beside the "
                       "configuration, nor in profiles/ there or among the installed ones\n")
    for place in ("share/canwire/profiles", "etc/profiles", "etc"):
        folder = tmp_path / place
        folder.mkdir(parents=True, exist_ok=True)
        rule = place.replace("/", "-")
        (folder / "wobble.yaml").write_text(
            f"faults: [ {{ name: {rule}, when: {{ time: 1ms }}, do: {{ error-flag: engine }} }} ]")
        assert used("wobble") == used("wobble.yaml") == [rule]
        if place != "etc":
            assert used("profiles/wobble.yaml") == used("profiles/wobble") == [rule]
    assert used("profiles/wobble") == ["etc-profiles"]
    assert "No such file or directory" in used("other/wobble.yaml")


def test_a_journal_knows_the_profile_that_was_found(tmp_path):
    """Its text is noted under the path that it was found at, which is not there any more."""
    profile = "faults: [ { name: x, when: { time: 1ms }, do: { error-flag: engine } } ]"
    config = [{"name": "gone/bus.yaml", "text": NAMED % "wobble"},
              {"name": "gone/profiles/wobble.yaml", "text": profile}]
    version = canwire("--version").stdout.split()[1]
    path = tmp_path / "journal"
    path.write_text("".join(json.dumps(line) + "\n" for line in (
        {"canwire-journal": 1, "canwire": version}, {"at": 0, "config": config},
        {"at": 160000, "end": dict(NONE, faults=1, error_frames=1)})))
    done = canwire("sim", "--journal", path, "--events", "-")
    assert '"rule":"x"' in done.stdout, done.stderr
