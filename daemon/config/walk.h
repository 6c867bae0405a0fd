/* SPDX-License-Identifier: MIT
 *
 * walk.h - the state of the readers of a configuration (schema.user).
 */
#ifndef CANWIRE_CONFIG_WALK_H
#define CANWIRE_CONFIG_WALK_H

#include "base/schema.h"
#include "config/config.h"

/* The destination of a walk, and the meaning of names in fault rules. */
typedef struct cfg_walk {
    cfg *config;
    const char *prefix;         /* of the names of rules, or NULL */
    size_t first_rule;          /* the rules that `after` may name begin here in config->rules */
    size_t list;                /* the rules of the present list begin here */
    const cfg_running *running; /* running rules, which `after` may name, too; they come first; or
                                   NULL */
    const cfg_file *given;      /* the files to read from; NULL: those of the file system */
    size_t given_count;
    bool others;                /* files that are not given are read from the file system */
    bool regular;               /* no file may be a pipe or a device */
    cfg_node defaults;          /* defaults of each node */
    bool default_order;         /* `defaults` sets it; otherwise it depends on the port */
    bool default_queue;         /* ... `defaults` sets its queue, which then does not depend on the
                                   port */
    bool default_when_full;
    const schema_key *node_keys; /* the keys of nodes */
    yaml_node_t *guests;        /* `guests`, or NULL */
    yaml_node_t *default_map;   /* `defaults`, or NULL */
    bool any_node;              /* unknown nodes are made: a profile is checked alone */
    bool untimed;               /* the bits of nodes are not known, after errors */
    bool unnamed;               /* a node's name could not be read: any name may refer to it */
} cfg_walk;

/* Returns the configuration that a walk reads into. */
static inline cfg *cfg_of(const schema *self)
{
    const cfg_walk *walk = self->user;
    return walk->config;
}

/* Returns true when a walk may read files that are not given. */
static inline bool cfg_reads_files(const schema *self)
{
    const cfg_walk *walk = self->user;
    return !walk->given || walk->others;
}

/* Returns the place of a value in its file. */
static inline cfg_place cfg_place_of(const yaml_node_t *value)
{
    return (cfg_place){.line = (int)value->start_mark.line + 1,
                       .column = (int)value->start_mark.column + 1};
}

#endif
