/* SPDX-License-Identifier: MIT
 *
 * loopless.c - finds frames that never come: those sent on a vcan without loopback.
 */
#include "port/loopless.h"

#include "port/netdev.h"

#include <errno.h>
#include <net/if.h>
#include <string.h>

typedef struct counts {
    bool seen[CW_NODES_MAX];
    uint64_t received[CW_NODES_MAX];
    uint64_t sent[CW_NODES_MAX];
} counts;

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

static bool read_counts(counts *c, const cfg *config)
{
    netdev_counters n;
    FILE *in = netdev_open();
    if (!in)
        return false;
    while (netdev_next(&n, in))
        note(c, config, &n);
    int error = ferror(in) ? errno : 0; /* what was read up to there is not all */
    (void)fclose(in);
    errno = error;
    return error == 0;
}

/* What has the name may be another interface than that of the port by now. */
static bool is_the_same(const cfg *config, const port *p, unsigned node)
{
    return if_nametoindex(config->nodes[node].port) == port_index(p);
}

/* Frames go on being counted meanwhile. With what was sent before and what was received after it,
 * the difference is never too large, the other way round never too small. */
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
