/* SPDX-License-Identifier: MIT
 *
 * walk.h - what the readers of a configuration know while they walk through it: schema.user.
 */
#ifndef CANWIRE_CONFIG_WALK_H
#define CANWIRE_CONFIG_WALK_H

#include "base/schema.h"
#include "config/config.h"

/* What a walk reads into, and what the names in fault rules may stand for. */
typedef struct cfg_walk {
    cfg *config;
    const char *prefix;         /* of the names of rules, or NULL */
    size_t first_rule;          /* what `after` may name begins here in config->rules */
    size_t list;                /* where the rules of the list that is read begin */
    const cfg_running *running; /* what else it may name, and what comes first; or NULL */
    const cfg_file *given;      /* the files to read from; NULL: those that there are */
    size_t given_count;
    bool regular;               /* no file may be a pipe or a device */
    cfg_node defaults;          /* what each node begins with */
    bool default_queue;         /* ... `defaults` says so: it does not depend on the port */
    bool default_when_full;
    bool any_node;              /* a node that is not there is made: a profile is checked alone */
    bool unnamed;               /* there is a node whose name could not be read: it may be any */
} cfg_walk;

/* The configuration that a walk reads into. */
static inline cfg *cfg_of(const schema *self)
{
    const cfg_walk *walk = self->user;
    return walk->config;
}

/* Where a value is in its file. */
static inline cfg_place cfg_place_of(const yaml_node_t *value)
{
    return (cfg_place){.line = (int)value->start_mark.line + 1,
                       .column = (int)value->start_mark.column + 1};
}

#endif
