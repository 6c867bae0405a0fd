# SPDX-License-Identifier: MIT
"""A user without rights pastes blocks of the documents that need no CAN in the kernel, again and
again. No line may need a moment that the reader does not wait. kernel/test_readme.py has
all blocks."""

import os
import subprocess
import tempfile

import pytest

from readme import ROOT, SYSTEM, Reader, blocks, first_block


@pytest.fixture(name="prefix", scope="module")
def fixture_prefix():
    """canwire, installed where every user can read it."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        places = {"PREFIX": f"{folder}/x", "SYSCONFDIR": "", "UNITDIR": "", "DESTDIR": folder}
        subprocess.run([ROOT / "scripts/install-files", "install"], check=True,
                       env={**os.environ, **places})
        yield f"{folder}{folder}/x"


@pytest.mark.parametrize("again", range(5))
def test_programs_run_without_can_in_the_kernel(prefix, again):  # pylint: disable=unused-argument
    text, (block,) = blocks("ci", "daemon/man/canwire-run.7.md")
    with Reader(f"{prefix}/bin:{SYSTEM}") as reader:
        reader.save("ci.yaml", text)
        reader.paste(block)
        assert reader.said().count("can0  123   [4]  DE AD BE EF") == 1


def test_three_lines_break_a_bit(prefix):
    with Reader(f"{prefix}/bin:{SYSTEM}") as reader:
        reader.paste(first_block("README.md"))
        assert reader.said() == first_block("README.md", 1)


def test_a_bus_is_watched(prefix):
    text, (block, *_) = blocks("seen", "daemon/man/canwire-record.7.md")
    with Reader(f"{prefix}/bin:{SYSTEM}") as reader:
        reader.save("seen.yaml", text)
        reader.paste(block)
        assert reader.said().count("0x123") == 3 and '"frame":"123#DEADBEEF"' in reader.said()
