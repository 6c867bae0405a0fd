# SPDX-License-Identifier: MIT
"""canwire: CAN buses, simulated bit by bit, in Python programs.

Bus is a bus in virtual time in this process. Importing this module loads no shared library; the
first bus does.
"""

from .bus import (Ahead, Bus, BusInfo, ConfigError, Error, ExpectationError, Node, NodeStatus,
                  Stop, Time)
from .campaigns import CampaignError, CampaignResult, campaign
from .columns import Columns
from .frame import Frame
from .rows import row
from .scenario import Scenario
from .virtualtime import Deadlock, VirtualTime

__all__ = ["Ahead", "Bus", "BusInfo", "CampaignError", "CampaignResult", "Columns", "ConfigError",
           "Deadlock", "Error", "ExpectationError", "Frame", "Node", "NodeStatus", "Scenario",
           "Stop", "Time", "VirtualTime", "campaign", "row"]
