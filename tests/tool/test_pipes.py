# SPDX-License-Identifier: MIT
"""A configuration that is a named pipe has no writer: nobody waits for one."""

import os

import pytest

from simtool import answer, canwire


@pytest.mark.parametrize("words", [["vcan", "up"], ["reload", "--config"]])
def test_a_pipe_in_place_of_a_configuration_is_refused(tmp_path, words):
    os.mkfifo(tmp_path / "pipe")
    assert "pipe: not a regular file" in answer(tmp_path, *words, "pipe", status=1)
