# SPDX-License-Identifier: MIT
"""Profiles are found by their names."""

import json
import os
import shutil
import subprocess
from pathlib import Path

from simtool import CANWIRE, CANWIRED, TIMEOUT_S, canwire, kill_all, stop_canwired
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
    share = "share/canwire/profiles"
    assert missing == (
        f"{path}:4:21: profiles: there is no wobble in {path.parent}, {path.parent}/profiles, "
        f"{tmp_path}/{share}, /usr/local/{share} and /usr/{share}\n")
    assert f"no profiles/wobble in {path.parent}, {tmp_path}/share/canwire, " in used(
        "profiles/wobble")
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
    assert used("woble").endswith(f" and /usr/{share} (did you mean 'wobble'?)\n")
    assert used("wobbel.yaml").endswith(" (did you mean 'wobble'?)\n")
    assert used("profiles/wable").endswith(" (did you mean 'profiles/wobble'?)\n")
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


def other_things_hide_no_profile(tool, folder, profile, inject):
    """A folder or a pipe here that has the name of the profile."""
    here = folder / "here"
    (here / "wobble.yaml").unlink()
    profile("share/canwire/profiles", "behind")
    (folder / "etc/wobble.yaml").unlink()
    (folder / "etc/profiles/wobble.yaml").unlink()
    (here / "bus.yaml").write_text((NAMED % "wobble").replace("engine", "a"))
    for make, name in ((Path.mkdir, "wobble"), (os.mkfifo, "wobble.yaml")):
        make(here / name)
        assert inject() == "behind\n"
        tool("clear", folder / "etc/x.sock", "behind")
        assert tool("check", "wobble").endswith(": ok (fault profile, 1 rule)\n")
        assert "1 rule" in tool("check", "bus.yaml")
    (folder / "share/canwire/profiles/wobble.yaml").unlink()
    for command in "check", "sim":
        told = tool(command, "bus.yaml", status=1)
        assert told.startswith("wobble: not a regular file")
    assert "wobble: Is a directory\n" in inject(status=1)
    assert "wobble: not a regular file" in tool("check", "wobble", status=1)
    (here / "wobble").rmdir()
    for words in (["wobble.yaml"], ["./wobble.yaml"]):
        told = tool("inject", folder / "etc/x.sock", *words, status=1)
        assert told == f"canwire inject: {words[0]}: not a regular file\n"
    assert "wobble.yaml: not a regular file" in tool("check", "wobble.yaml", status=1)
    rule = "{ name: piped, when: { manual: yes }, do: { error-flag: a } }"
    done = subprocess.run(["bash", "-c", f"'{CANWIRE}' inject '{folder}/etc/x.sock' "
                           f"<(sleep 0.1; echo '{rule}')"],
                          capture_output=True, text=True, timeout=TIMEOUT_S, check=True)
    assert done.stdout == "piped\n"


def test_commands_find_profiles_by_name(tmp_path):
    """check and inject look here first; inject then looks beside the configuration of the bus."""
    program, here = tmp_path / "bin/canwire", tmp_path / "here"
    for folder in (program.parent, here, tmp_path / "etc/profiles",
                   tmp_path / "share/canwire/profiles"):
        folder.mkdir(parents=True)
    shutil.copy(CANWIRE, program)
    config = tmp_path / "etc/bus.yaml"
    config.write_text("bus: { name: x, bitrate: 500000 }\nnodes: [ { name: a }, { name: b } ]\n"
                      "control: x.sock\n")

    def tool(*words, status=0):
        done = subprocess.run([program, *words], capture_output=True, text=True, cwd=here,
                              timeout=TIMEOUT_S, check=False)
        assert done.returncode == status, done
        return done.stderr if status else done.stdout

    def profile(folder, rule):
        path = tmp_path / folder / "wobble.yaml"
        path.write_text(f"faults: [ {{ name: {rule}, when: {{ manual: yes }}, do: "
                        "{ error-flag: a } } ]")
        return path

    def inject(status=0):
        return tool("inject", tmp_path / "etc/x.sock", "wobble", status=status)

    share = "share/canwire/profiles"
    installed = f"{tmp_path}/{share}, /usr/local/{share} and /usr/{share}\n"
    assert tool("check", "wobble", status=1) == (
        f"canwire check: there is no wobble in ., profiles, {installed}")
    assert "wobble.yaml: No such file" in tool("check", "wobble.yaml", status=1)
    log = tmp_path / "log"
    with log.open("w") as errors:
        daemon = subprocess.Popen([CANWIRED, "-c", config], stderr=errors)
    try:
        assert inject(status=1) == (f"canwire inject: there is no wobble in ., profiles, "
                                    f"{config.parent}, {config.parent}/profiles, {installed}")
        places = {share: "installed", "etc/profiles": "listed", "etc": "beside", "here": "here"}
        for folder, rule in places.items():
            path = profile(folder, rule)
            assert inject() == rule + "\n"
            if folder in (share, "here"):
                found = "wobble.yaml" if folder == "here" else path
                assert tool("check", "wobble") == f"{found}: ok (fault profile, 1 rule)\n"
        other_things_hide_no_profile(tool, tmp_path, profile, inject)
        stop_canwired(daemon, log)
    finally:
        kill_all([daemon])
