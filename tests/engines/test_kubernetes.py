# SPDX-License-Identifier: MIT
"""The manifest for Kubernetes: valid for its API, and its command does what the job needs. No
cluster runs here: the test takes the place of the kubelet.
"""

import json
import os
import signal
import subprocess

import jsonschema
import pytest
import yaml

import campaigns
from engine import fixture_gate, fixture_place  # pylint: disable=unused-import
from simtool import CANWIRE, ROOT, TIMEOUT_S

TEXT = (ROOT / "config/campaign/kubernetes.yaml").read_text()
MANIFEST = yaml.safe_load(TEXT)
POD = MANIFEST["spec"]["template"]["spec"]
SCHEMA = json.loads((ROOT / "tests/engines/kubernetes-job.schema.json").read_text())


def errors(manifest):
    validator = jsonschema.Draft202012Validator(SCHEMA)
    return [error.message for error in validator.iter_errors(manifest)]


def test_the_manifest_is_valid_for_the_api():
    assert not errors(MANIFEST)
    assert MANIFEST["apiVersion"] == "batch/v1" and MANIFEST["kind"] == "Job"


@pytest.mark.parametrize("right, wrong", [
    ("completions: 64", "completions: many"), ("completionMode", "completion-mode"),
    ("value: \"64\"", "value: 64"), ("claimName: campaign-rows", "claim: campaign-rows"),
    ("readOnly: true", "readOnly: 1"), ("kind: Job", "kind: Pod"), ("command:", "command: sh\n#"),
])
def test_the_schema_finds_mistakes(right, wrong):
    assert right in TEXT
    bad = TEXT.replace(right, wrong)
    if wrong.startswith("command"):
        bad = "\n".join(line for line in bad.splitlines()
                        if not line.strip().startswith(("- /bin/sh", "- -c", "- >-", "out=",
                                                        "canwire campaign run")))
    assert errors(yaml.safe_load(bad))


def test_numbers_and_volumes_fit_together():
    container, = POD["containers"]
    count = MANIFEST["spec"]["completions"]
    assert MANIFEST["spec"]["completionMode"] == "Indexed"
    assert container["env"] == [{"name": "JOB_COMPLETIONS", "value": str(count)}]
    volumes = {volume["name"] for volume in POD["volumes"]}
    assert {mount["name"] for mount in container["volumeMounts"]} == volumes == {"files", "rows"}
    assert container["workingDir"] == next(
        mount["mountPath"] for mount in container["volumeMounts"] if mount["name"] == "files")
    # of pods that are not started again, the kubelet would count each; a container goes on in place
    assert POD["restartPolicy"] == "OnFailure"


class Node:
    """Starts the container of an index as a node does, with folders in place of the volumes."""

    def __init__(self, place):
        container, = POD["containers"]
        mounts = {mount["name"]: mount["mountPath"] for mount in container["volumeMounts"]}
        self.place, self.rows = place, place / "volume"
        self.rows.mkdir()
        self.command = [word.replace(mounts["rows"] + "/", f"{self.rows}/")
                        for word in container["command"]]
        self.variables = {entry["name"]: entry["value"] for entry in container["env"]}

    def start(self, index):
        return subprocess.Popen(self.command, cwd=self.place, stderr=subprocess.PIPE, env={
            **os.environ, **self.variables, "JOB_COMPLETION_INDEX": str(index)})


def test_a_killed_container_is_started_again(place, gate):
    node = Node(place)
    first = node.start(4)
    os.kill(list(gate.wait())[1], signal.SIGKILL)
    first.communicate(timeout=TIMEOUT_S)
    assert first.returncode != 0 and not list(node.rows.glob("*.ndjson"))
    gate.open()
    wanted = campaigns.rows("campaign.yaml", place)
    shard = subprocess.run([CANWIRE, "campaign", "run", "campaign.yaml", "--shard", "5/64"],
                           cwd=place, capture_output=True, check=False).stdout
    # a part as a kill in the middle of a row leaves it
    (node.rows / "0000004.ndjson.part").write_bytes(shard[:len(shard) // 2])
    for index in range(MANIFEST["spec"]["completions"]):
        container = node.start(index)
        _, message = container.communicate(timeout=TIMEOUT_S)
        assert container.returncode == 0, message
    commands = [line.strip("# ") for line in TEXT.splitlines()
                if line.startswith(("#   cat", "#   canwire"))]
    script = "\n".join(commands).replace("rows/*", f"{node.rows}/*")
    subprocess.run(["sh", "-c", script], cwd=place, check=False, timeout=TIMEOUT_S)
    assert (place / "rows.ndjson").read_bytes() == wanted
