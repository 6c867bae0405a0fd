# SPDX-License-Identifier: MIT
"""The package from the checkout, with the library that has just been built."""

import os
from pathlib import Path

from simtool import CANWIRE

os.environ["CANWIRE_SIM_LIBRARY"] = str(Path(CANWIRE).with_name("libcanwire-sim.so"))
