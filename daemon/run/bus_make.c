/* SPDX-License-Identifier: MIT
 *
 * bus_make.c - makes the bus of a configuration, with room for later rules and settings.
 */
#include "run/bus_make.h"

#include "run/release.h"

#include <errno.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#define INBOX_FRAMES 9216 /* the engine keeps 1024 of them for traffic */
#define EVENT_RING 4096

/* Returns the bytes of a bus, with room behind it for records of the nodes' clocks. */
static size_t bytes_of(const cw_bus_config *config)
{
    const size_t align = _Alignof(max_align_t);
    return (cw_bus_size(config) + align - 1) / align * align;
}

/* Takes guests off the bus, and with `usb` nodes that wait for their adapter. Nobody shall see the
 * events. */
static void take_off(cw_bus *bus, const cfg *config, bool usb)
{
    cw_event event;
    for (unsigned i = 0; i < config->node_count; i++) {
        const cfg_node *node = &config->nodes[i];
        if (node->guest == 0 && !(usb && cfg_is_usb(node)))
            continue;
        while (cw_node_attach(bus, i, false) == CW_FULL)
            (void)cw_bus_poll(bus, &event);
    }
    while (cw_bus_poll(bus, &event))
        continue;
}

void bus_take_guests_off(cw_bus *bus, const cfg *config)
{
    take_off(bus, config, false);
}

cw_bus *bus_init(void *memory, const cw_bus_config *config)
{
    cw_bus *bus = memory && cw_bus_size(config) > 0 ? cw_bus_init(memory, config) : NULL;
    if (!bus && memory)
        errno = EINVAL;
    return bus;
}

const char *bus_why_not(void)
{
    if (errno == EINVAL)
        return "the bus does not take this configuration";
    return errno == ENOMEM ? "out of memory" : strerror(errno);
}

cw_bus *bus_make(void **memory, const cfg *config)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus_config;
    cfg_bus_config(&bus_config, nodes, config);
    for (unsigned i = 0; i < bus_config.node_count; i++)
        nodes[i].queue_room = CW_QUEUE_MAX; /* for `set`; unused slots cost no memory */
    bus_config.inbox = INBOX_FRAMES;
    bus_config.events = EVENT_RING;
    bus_config.rule_room = (uint16_t)(CW_RULES_MAX - bus_config.rule_count);
    const size_t bytes = bytes_of(&bus_config);
    const size_t records = config->node_count; /* `set` may take it off the grid */
    *memory = malloc(bytes + records * sizeof(cw_sync_record));
    cw_bus *bus = bus_init(*memory, &bus_config);
    if (bus) {
        void *behind = (unsigned char *)*memory + bytes;
        cw_bus_set_sync_records(bus, behind);
    }
    if (bus) {
        release_add_replies(bus, config);
        take_off(bus, config, true);
    }
    return bus;
}
