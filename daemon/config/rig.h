/* SPDX-License-Identifier: MIT
 *
 * rig.h - reads a rig: several buses, and the gateways between their nodes.
 */
#ifndef CANWIRE_CONFIG_RIG_H
#define CANWIRE_CONFIG_RIG_H

#include "base/schema.h"
#include "config/config.h"

#define RIG_BUSES_MAX 16u
#define RIG_GATEWAYS_MAX 64u
#define RIG_RULES_MAX 64u /* of one gateway */
#define RIG_QUEUE_MAX 1024u

/* A node of a bus. */
typedef struct rig_end {
    size_t bus;
    unsigned node;
    const char *bus_name;
    const char *name; /* of the node */
} rig_end;

/* The directions of a rule, as a set of the end that receives: 1 << 0 the first end. */
typedef enum rig_direction {
    RIG_FORWARD = 1,  /* from the first end to the second */
    RIG_BACKWARD = 2,
    RIG_BOTH = 3,
} rig_direction;

/* A rule of a gateway for some frames. It never looks at their data. */
typedef struct rig_rule {
    cfg_place place;
    cw_filter filters[CW_RULE_FILTERS_MAX]; /* without any, every frame matches */
    uint8_t filter_count;
    bool has_id;      /* frames get another identifier */
    uint32_t id;      /* ... as in a can_id, with CW_FILTER_EXTENDED */
    cfg_time delay;   /* in ns; from the reception to the hand-over to the other node */
    uint32_t queue;   /* frames that wait for the end of their delay; others are lost */
    unsigned direction; /* a rig_direction */
} rig_rule;

/* For each direction, the first rule that matches a frame decides. Other frames stay. */
typedef struct rig_gateway {
    const char *name;
    rig_end ends[2];
    size_t rule_count;
    rig_rule *rules;
} rig_gateway;

typedef struct rig {
    const char *file;
    char *text; /* of the file, owned by the rig */
    size_t size;
    size_t bus_count;
    cfg **buses; /* owned by the rig; NULL where somebody has taken one */
    const char *names[RIG_BUSES_MAX]; /* of the buses */
    size_t gateway_count;
    rig_gateway *gateways;
} rig;

/* Returns true when a file can be read and has a key `buses`: it is not a configuration of one bus.
 * Writes no messages. */
bool rig_is_rig(const char *file);

/* Reads a rig and the configurations of its buses. Returns NULL after writing one line per error to
 * `errors`. Warnings of the buses are in their configurations. */
rig *rig_load(const char *file, FILE *errors);

/* Does the same with a text; paths in it are relative to the directory of its name. */
rig *rig_load_text(const cfg_file *file, FILE *errors);

/* Does the same where the files of some buses are texts, too. Their names are those that the rig
 * writes. */
rig *rig_load_given(const cfg_file *file, const cfg_file *buses, size_t count, FILE *errors);

/* Reads a rig, or the configuration of one bus, out of a file or of a text. The caller gets one of
 * both, to be freed. Returns false after errors. */
bool rig_load_either(rig **several, cfg **alone, const cfg_file *file, FILE *errors);

/* Returns true when the file still has the text of a rig. Otherwise it writes a line to
 * `errors`. */
bool rig_is_same(const char *file, const char *text, size_t size, FILE *errors);

/* Frees the rig and its buses; NULL is allowed. */
void rig_free(rig *self);

/* Returns the rule that decides about a frame with that can_id, which end `end` has received, or
 * NULL: the frame stays. */
const rig_rule *rig_find_rule(const rig_gateway *gateway, unsigned end, const cw_frame *frame);

/* The keys of the file. */
extern const schema_key rig_file_keys[];

#define RIG_LOOP_MAX 16u /* gateways of a loop */

/* A frame for ever under way: each gateway of the list hands it to the next one, the last one to
 * the first one. A gateway may be there twice, for two identifiers of the frame. */
typedef struct rig_loop {
    unsigned count;
    const rig_gateway *gateways[RIG_LOOP_MAX];
    const rig_rule *rule; /* of the first gateway */
    cw_frame frame;       /* one that goes round, as the first gateway receives it */
} rig_loop;

/* Returns true when frames go round, and describes one such loop, of at most RIG_LOOP_MAX gateways.
 * It looks at the rules, and at the filters, mailboxes, kind and loopback of the nodes. */
bool rig_find_loop(rig_loop *loop, const rig *self);

#endif
