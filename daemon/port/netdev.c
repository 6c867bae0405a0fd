/* SPDX-License-Identifier: MIT
 *
 * netdev.c - reads the packet counters of network interfaces from /proc/net/dev.
 */
#include "port/netdev.h"

#include <inttypes.h>

#define LINE_BYTES 512 /* a name and 16 numbers */

/* Opens the counters, not as /proc/net/dev: that is missing where /proc shows nothing but processes
 * (ProcSubset=pid). */
FILE *netdev_open(void)
{
    return fopen("/proc/self/net/dev", "re");
}

/* "  vcan0: BYTES PACKETS errs drop fifo frame compressed multicast BYTES PACKETS …": received,
 * then sent. */
static bool netdev_read_line(netdev_counters *out, const char *line)
{
    _Static_assert(IF_NAMESIZE == 16, "the width below");
    return sscanf(line,
                  " %15[^: ]: %*u %" SCNu64 " %*u %*u %*u %*u %*u %*u %*u %" SCNu64, out->name,
                  &out->received, &out->sent) == 3;
}

bool netdev_next(netdev_counters *out, FILE *in)
{
    char line[LINE_BYTES];
    while (fgets(line, sizeof line, in))
        if (netdev_read_line(out, line)) /* two lines of titles have no counters */
            return true;
    return false;
}
