# SPDX-License-Identifier: MIT
"""A campaign on a cluster of Dask: python3 on_dask.py FILE ROWS [SCHEDULER]

Without the address of a scheduler it makes a cluster on this machine. The workers need the Python
package canwire and the tool canwire. After any end, the same call goes on.
"""
import sys

import canwire
from distributed import Client

if __name__ == "__main__":
    with Client(*sys.argv[3:4]) as client:
        result = canwire.campaign(sys.argv[1], executor=client, out=sys.argv[2])
    print(result.counts)
