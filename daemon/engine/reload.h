/* SPDX-License-Identifier: MIT
 *
 * reload.h - prepares another configuration while the bus runs.
 *
 * All steps that can fail (reading files, opening ports, memory) happen here, before the bus
 * changes. Files are read first, in any thread. Nodes are matched by name.
 */
#ifndef CANWIRE_ENGINE_RELOAD_H
#define CANWIRE_ENGINE_RELOAD_H

#include "config/files.h"
#include "port/door.h"
#include "port/port.h"
#include "run/release.h"

/* A bus with its memory, releases and ports. */
typedef struct setup {
    void *memory; /* of the bus */
    cw_bus *bus;
    release_plan *plan;
    port *ports[CW_NODES_MAX]; /* by node; NULL without */
    port *door;                /* of the guests; NULL: there are none */
} setup;

/* Makes bus and releases of a configuration, without ports. Files of replays are opened and read
 * ahead. Returns false without memory; the setup must be freed even then. */
bool setup_make(setup *s, const cfg *config);

/* Closes the ports and frees the setup. */
void setup_free(setup *s);

/* The next configuration of a bus. */
typedef struct reload {
    cfg *config;
    setup setup;                     /* its ports, and its door, are only the new ones */
    uint8_t from[CW_NODES_MAX];      /* by new node: the old one of that name, otherwise
                                        CW_NO_NODE */
    uint8_t port_from[CW_NODES_MAX]; /* by new node: the old one on that port, otherwise
                                        CW_NO_NODE */
    uint64_t deadline;               /* tick: no later than this, even in the middle of a frame */
} reload;

/* Reads a configuration and all files that it names. This may take as long as a disk or network
 * hangs, so it is not for the thread of the bus. others: further files of canwired, or NULL.
 * Returns NULL after writing a line per error. */
reload *reload_read(const char *file, const fileuses *others, FILE *errors);

/* Prepares the reload to replace the old configuration. pending: an earlier reload that waits for
 * the bus, or NULL; this one replaces it and gets its open ports. Returns false, with nothing
 * changed, after writing a line per error. */
bool reload_match(reload *r, const cfg *old, reload *pending, FILE *errors);

#define RELOAD_REMAP_BYTES_MAX 512u

/* Moves each node's element of an array to the node's new place; new nodes get zeros. The array has
 * CW_NODES_MAX elements of that size, at most RELOAD_REMAP_BYTES_MAX. */
void reload_remap(void *array, size_t size, const uint8_t from[CW_NODES_MAX]);

/* Frees a reload with all that has not been taken out of it. NULL is allowed. */
void reload_free(reload *r);

#endif
