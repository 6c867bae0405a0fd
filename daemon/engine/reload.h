/* SPDX-License-Identifier: MIT
 *
 * reload.h - from one configuration to the next while the bus runs: what is prepared beforehand.
 *
 * Everything that can fail (reading files, opening ports, memory) is done here, before the bus is
 * touched. Files are read first, in whatever thread. Nodes are matched by name.
 */
#ifndef CANWIRE_ENGINE_RELOAD_H
#define CANWIRE_ENGINE_RELOAD_H

#include "config/files.h"
#include "port/port.h"
#include "run/release.h"

/* A bus with all that it needs. */
typedef struct setup {
    void *memory; /* of the bus */
    cw_bus *bus;
    release_plan *plan;
    port *ports[CW_NODES_MAX]; /* by node; NULL without */
} setup;

/* Makes bus and releases of a configuration, without ports; files that are replayed are opened and
 * read ahead. False when there is no memory; the setup is to be freed all the same. */
bool setup_make(setup *s, const cfg *config);

/* Closes the ports and frees all. */
void setup_free(setup *s);

/* What a bus is to go over to. */
typedef struct reload {
    cfg *config;
    setup setup;                     /* ports: only those that are new */
    uint8_t from[CW_NODES_MAX];      /* by new node: the old one of that name, else CW_NO_NODE */
    uint8_t port_from[CW_NODES_MAX]; /* by new node: the old one on that port, else CW_NO_NODE */
    uint64_t deadline;               /* tick: no later than this, even in the middle of a frame */
} reload;

/* Reads a configuration and all files that it names, which may take as long as a disk or network
 * hangs: not for the thread of the bus. others: files that canwired has besides, or NULL. NULL
 * after writing a line per error. */
reload *reload_read(const char *file, const fileuses *others, FILE *errors);

/* Prepares what has been read to take the place of the old configuration. pending: what the bus was
 * to go over to so far, or NULL; this is to take its place and gets the ports that it has opened.
 * False, with nothing changed, after writing a line per error. */
bool reload_match(reload *r, const cfg *old, reload *pending, FILE *errors);

#define RELOAD_REMAP_BYTES_MAX 512u

/* Moves what an array keeps of each node to the node's new place; what new nodes have is all
 * zero. The array has CW_NODES_MAX elements of that size, at most RELOAD_REMAP_BYTES_MAX. */
void reload_remap(void *array, size_t size, const uint8_t from[CW_NODES_MAX]);

/* Frees what has not been taken out of it. NULL is fine. */
void reload_free(reload *r);

#endif
