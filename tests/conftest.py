# SPDX-License-Identifier: MIT
"""Fixtures of the tests that need no CAN in the kernel."""

import pytest


@pytest.fixture(name="write")
def fixture_write(tmp_path):
    """write(text) is the path of a file with that text; write(text, name) has another name."""
    def write(text, name="bus.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write
