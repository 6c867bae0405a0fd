# SPDX-License-Identifier: MIT
"""README.md: "A bus in a Python program", and the example of config/python.md."""

import contextlib
import io
import re

from simtool import ROOT


def output_of(path, title):
    text = (ROOT / path).read_text().split(title)[1]
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL)[1]
    with contextlib.redirect_stdout(io.StringIO()) as out:
        exec(compile(code, path, "exec"), {})  # pylint: disable=exec-used
    return out.getvalue()


def test_a_bus_in_a_python_program():
    stop, _, tec, states = output_of("README.md",
                                     "## A bus in a Python program").split(" ", 3)
    assert (stop, tec) == ("Stop.EVENT", "256")  # 32 errors of 8 each
    assert re.findall("'state': '([a-z-]+)'", states) == ["error-warning", "error-passive",
                                                          "bus-off"]


def test_the_example_of_the_package():
    first, second = output_of("config/python.md", "# CAN buses").splitlines()
    assert first == "123#DEADBEEF" and second.startswith("8 [{'t': 0.000164, 'node': 'gearbox'")
