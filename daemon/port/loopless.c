/* SPDX-License-Identifier: MIT
 *
 * loopless.c - counts frames that nobody receives, by the packet counters of interfaces.
 */
#include "port/loopless.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>

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

typedef struct counts {
    bool seen[CW_NODES_MAX];
    uint64_t received[CW_NODES_MAX];
    uint64_t sent[CW_NODES_MAX];
} counts;

/* Keeps the counters of an interface for each node whose port it is. */
static void note(counts *c, const cfg *config, const netdev_counters *n)
{
    for (unsigned i = 0; i < config->node_count; i++) {
        if (!config->nodes[i].port || strcmp(config->nodes[i].port, n->name) != 0)
            continue;
        c->seen[i] = true;
        c->received[i] = n->received;
        c->sent[i] = n->sent;
    }
}

/* Reads the counters of all interfaces once. Returns false with errno; what was read may then lack
 * some. */
static bool read_counts(counts *c, const cfg *config)
{
    netdev_counters n;
    FILE *in = netdev_open();
    if (!in)
        return false;
    while (netdev_next(&n, in))
        note(c, config, &n);
    int error = ferror(in) ? errno : 0; /* the counters read so far are incomplete */
    (void)fclose(in);
    errno = error;
    return error == 0;
}

/* Returns true when the interface of that name is still the one of the port. */
static bool is_the_same(const cfg *config, const port *p, unsigned node)
{
    return if_nametoindex(config->nodes[node].port) == port_index(p);
}

/* Compares counters, which go on counting meanwhile. Frames sent before, less frames received after
 * them, are never too many; the reverse is never too few. */
bool loopless_look(const cfg *config, port *const ports[], uint64_t vcans)
{
    counts before = {.seen = {false}};
    counts after = {.seen = {false}};
    if (!read_counts(&before, config) || !read_counts(&after, config))
        return false;
    for (unsigned i = 0; i < config->node_count; i++) {
        if (!ports[i] || !before.seen[i] || !after.seen[i] || !is_the_same(config, ports[i], i))
            continue;
        port_count_loopless(ports[i], (int64_t)(before.sent[i] - after.received[i]),
                            (int64_t)(after.sent[i] - before.received[i]), vcans >> i & 1u);
    }
    return true;
}
