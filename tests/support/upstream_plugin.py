# SPDX-License-Identifier: MIT
"""A plugin of pytest for the tests of other projects (upstream.py).

It sets attributes of their classes, as subclasses do, and writes the outcome of each test.
"""

import json


def pytest_addoption(parser):
    group = parser.getgroup("upstream")
    group.addoption("--attribute", action="append", default=[], metavar="CLASS.NAME=VALUE",
                    help="set an attribute of a class of tests; VALUE is JSON")
    group.addoption("--outcomes", help="a file for a line of JSON per test")


def pytest_configure(config):
    config.addinivalue_line("markers", "timeout: limits the time of a test (pytest-timeout)")


def classes(items):
    return {one for item in items if item.cls for one in item.cls.__mro__}


def pytest_collection_modifyitems(config, items):
    for text in config.getoption("attribute"):
        name, value = text.split("=", 1)
        wanted, attribute = name.split(".")
        for one in classes(items):
            if one.__name__ == wanted:
                getattr(one, attribute)  # AttributeError: the class does not have it any more
                setattr(one, attribute, json.loads(value))


class Outcomes:
    """Collects reports of set-up, call and tear-down; the worst is the outcome."""

    def __init__(self, path):
        self.path, self.tests = path, {}

    def pytest_runtest_logreport(self, report):
        rank = ["passed", "skipped", "failed"]
        before = self.tests.get(report.nodeid, ("passed", ""))
        if rank.index(report.outcome) > rank.index(before[0]):
            before = (report.outcome, str(report.longrepr))
        self.tests[report.nodeid] = before

    def pytest_sessionfinish(self):
        with open(self.path, "w", encoding="utf-8") as file:
            json.dump(self.tests, file)


def pytest_sessionstart(session):
    path = session.config.getoption("outcomes")
    if path:
        session.config.pluginmanager.register(Outcomes(path))
