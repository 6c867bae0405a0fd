# SPDX-License-Identifier: MIT
"""The examples of canwire-python(7)."""

import contextlib
import io
import re

from canwire import _library
from simtool import ROOT

PAGE = "daemon/man/canwire-python.7.md"


def output_of(begin):
    text = (ROOT / PAGE).read_text().split(begin)[1]
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(code, PAGE, "exec"), {})  # pylint: disable=exec-used
    return out.getvalue()


def test_time_goes_on_up_to_an_event():
    stop, _, tec, states = output_of("Time goes on up to an event").split(" ", 3)
    assert (stop, tec) == ("Stop.EVENT", "256")  # 32 errors of 8 each
    assert re.findall("'state': '([a-z-]+)'", states) == ["error-warning", "error-passive",
                                                          "bus-off"]


def test_the_example_of_the_package():
    first, second = output_of("## Description").splitlines()
    assert first == "123#DEADBEEF" and second.startswith("8 [{'t': 0.000164, 'node': 'gearbox'")


def test_the_example_of_columns():
    # 11 bits until all nodes are on the bus, 53 with a stuff bit, but for the last one of EOF
    assert output_of("takes the events since the last call").split() == ["2000", "126000", "rx"]


def test_all_columns_are_described():
    table = (ROOT / PAGE).read_text().split("| column | |")[1].split("\n\n")[0]
    first = [line.split("|")[1] for line in table.splitlines()[2:]]
    assert {name for cell in first for name in re.findall(r"`(\w+)`", cell)} == \
        _library.COLUMNS.keys()
