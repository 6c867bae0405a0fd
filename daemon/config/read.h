/* SPDX-License-Identifier: MIT
 *
 * read.h - readers that the parts of the configuration share. schema.user is a cfg_walk.
 */
#ifndef CANWIRE_CONFIG_READ_H
#define CANWIRE_CONFIG_READ_H

#include "base/schema.h"
#include "config/config.h"

#define NODE_NAME_MAX 32u                    /* of a bus too */
#define RULE_NAME_MAX (CW_RULE_NAME_MAX - 1) /* what the library tells apart */

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

schema_reader cfg_read_faults;    /* object: the cfg, with its bit rate and nodes already read */
schema_reader cfg_read_profiles;  /* the same */
schema_reader cfg_read_expect;    /* the same, with all rules already read */
schema_reader cfg_read_action;    /* `do`; object: a cw_rule whose `when` has been read */
schema_reader cfg_read_traffic;   /* object: a cfg_node whose port has been read */
schema_reader cfg_read_filters;   /* frames; object: a cw_rule, or what begins with one */
schema_reader cfg_read_data;      /* the same */
schema_reader cfg_read_window;    /* the same; exact */
schema_reader cfg_read_record;    /* object: the cfg */
schema_reader cfg_read_time;      /* member: cfg_time */
schema_reader cfg_read_span;      /* the same, not 0 */
schema_reader cfg_read_ticks;     /* member: uint64_t, of a time */
schema_reader cfg_read_ticks_min; /* the same, not 0 */
schema_reader cfg_read_bits;      /* the same, of what acts at bits: warns when it is rounded */
schema_reader cfg_read_bits_min;  /* the same, not 0 */
schema_reader cfg_read_fraction;  /* member: uint64_t, of 2^64 */
schema_reader cfg_read_frame;     /* member: cw_frame */
schema_reader cfg_read_node_set;  /* member: uint64_t; a node or a list of them */

/* Moves the warnings of a file without errors into its memory; false after a complaint. */
bool cfg_keep_warnings(const char **warnings, arena *memory, diag *found);

/* Where a value is in its file. */
static inline cfg_place cfg_place_of(const yaml_node_t *value)
{
    return (cfg_place){.line = (int)value->start_mark.line + 1,
                       .column = (int)value->start_mark.column + 1};
}

/* Warns about a time of so many ticks that acts at bits and is no whole number of them. */
void cfg_warn_rounded(schema *self, const schema_key *key, const yaml_node_t *value,
                      uint64_t ticks);

/* The names of `order`. */
extern const schema_choice cfg_orders[];

/* The CW_MODE_* that a key such as one-shot stands for. */
uint8_t cfg_mode(const char *name);

/* Whether an action needs a frame on the bus, whatever the rule waits for. */
bool cfg_action_needs_frame(cw_action what);

/* A name, from letters, digits, '_', '.' and '-'; complains about others, but returns them, so that
 * what refers to them is still understood. NULL when there is no text. */
char *cfg_read_name(schema *self, const schema_key *key, const yaml_node_t *value,
                    size_t length_max);

bool cfg_name_valid(const char *name, size_t length_max);

/* The states that a value names, one or a list, as bits. */
uint8_t cfg_read_states(schema *self, const schema_key *key, yaml_node_t *value);

/* What a node is called whose name is not known: it is found by no name. */
extern char cfg_no_name[];

/* The index of the node that a value names, or -1 when there is none, which has been told. */
int cfg_read_node(schema *self, const schema_key *key, const yaml_node_t *value, const char *name);

/* Adds a list of rules to the configuration, or one rule. */
void cfg_read_rules(schema *self, const schema_key *key, yaml_node_t *value);

/* A path relative to the directory of the file that names it, or NULL after a complaint. */
char *cfg_resolve_path(schema *self, const char *file, const char *path);

/* Loads the document of a file, keeps its text in the configuration. False after a complaint. */
bool cfg_load_file(schema *self, yaml_document_t *document, const char *file);

/* Whether a document is a profile and no configuration. */
bool cfg_is_profile(schema *self, const yaml_node_t *root);

/* Reads rules from the root of a profile, which may have its own `with`. With walk->any_node
 * parameters without default stand for anything. */
void cfg_read_profile(schema *self, yaml_node_t *root);

#endif
