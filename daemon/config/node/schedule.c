/* SPDX-License-Identifier: MIT
 *
 * schedule.c - local times of nodes, and their schedules: the keys of `local-time` and `schedule`.
 */
#include "config/parts.h"

#include "base/divisor.h"
#include "config/values.h"
#include "trace/frametext.h"

#include <inttypes.h>
#include <string.h>

#define NO_CYCLE UINT16_MAX

enum { WINDOW_EXCLUSIVE = 0, WINDOW_ARBITRATING };

static schema_reader read_unit, read_reference, read_triggers, read_units, read_slot;

static const schema_range bits_range = {CW_LOCAL_BITS_MIN, CW_LOCAL_BITS_MAX, sizeof(uint8_t)};
static const schema_range start_range = {0, UINT32_MAX, sizeof(uint32_t)};
static const schema_range cycles_range = {1, CW_CYCLES_MAX, sizeof(uint8_t)};
static const schema_range byte_range = {0, CW_FRAME_DATA_MAX - 1, sizeof(uint8_t)};
static const schema_range cycle_range = {0, CW_CYCLES_MAX - 1, sizeof(uint16_t)};
static const schema_range repeat_range = {1, CW_CYCLES_MAX, sizeof(uint16_t)};

static const schema_choice moments[] = {
    {.name = "sof", .value = false},
    {.name = "eof", .value = true},
    {.name = NULL},
};

static const schema_choice windows[] = {
    {.name = "exclusive", .value = WINDOW_EXCLUSIVE},
    {.name = "arbitrating", .value = WINDOW_ARBITRATING},
    {.name = NULL},
};

/* ---- Local time ------------------------------------------------------------------------------ */

typedef struct local_time {
    cw_local_time time;
    unsigned moment; /* a word of moments */
} local_time;

const schema_key cfg_local_time_keys[] = {
    {.name = "unit", .read = read_unit, .offset = offsetof(local_time, time.unit), .type = "span",
     .preset = "1us",
     .help = "Time of one count, 13ns to 1s."},
    {.name = "bits", .read = schema_read_uint, .offset = offsetof(local_time, time.bits),
     .arg = &bits_range,
     .preset = "16",
     .help = "Its width; it wraps to 0."},
    {.name = "capture", .read = schema_read_choice, .offset = offsetof(local_time, moment),
     .arg = moments,
     .preset = "sof",
     .help = "The bit of frames at whose sample point it is captured: SOF, or the last one of "
             "EOF."},
    {.name = "start", .read = schema_read_uint, .offset = offsetof(local_time, time.start),
     .arg = &start_range,
     .preset = "0",
     .help = "Its value at bus time 0."},
    {.name = NULL},
};

/* A unit is not shorter than a tick of the bus. */
static void read_unit(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cw_span *unit = schema_member(key, object);
    const size_t errors = self->errors->errors;
    cfg_read_fine_min(self, key, value, object);
    if (self->errors->errors == errors && (*unit < CW_TICK || *unit > CW_LOCAL_UNIT_MAX))
        schema_complain(self, value, "%s: a unit of local time lasts 13ns to 1s", key->name);
}

/* Reads the local time of a node. `start` must fit its counter. */
void cfg_read_local_time(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    local_time read = {.moment = false};
    schema_read_presets(self, cfg_local_time_keys, &read);
    const cw_span usual = read.time.unit;
    const size_t errors = self->errors->errors;
    schema_map(self, key->name, value, cfg_local_time_keys, &read);
    if (self->errors->errors != errors)
        read.time.unit = usual;
    else if ((uint64_t)read.time.start >> read.time.bits)
        schema_complain(self, value, "start: a counter of %u bits goes up to %" PRIu64,
                        read.time.bits, (UINT64_C(1) << read.time.bits) - 1);
    read.time.at_eof = read.moment;
    node->local = read.time;
}

/* ---- Triggers -------------------------------------------------------------------------------- */

/* A trigger as its keys say. */
typedef struct trigger {
    cw_time_trigger time;
    unsigned window;
    yaml_node_t *map;
    const cfg_node *node;
} trigger;

static const schema_key trigger_keys[] = {
    {.name = "at", .read = read_units, .offset = offsetof(trigger, time.at), .required = true,
     .type = TYPE_ANY(TYPE_INTEGER(0, 4294967295) ", " TYPE_REF("time")),
     .help = "Local time after the capture of the reference message; a time is rounded down."},
    {.name = "slot", .read = read_slot, .offset = offsetof(trigger, time.slot), .required = true,
     .type = TYPE_ANY(TYPE_INTEGER(0, 4294967295) ", " TYPE_REF("time")),
     .help = "The frame begins before so much local time has passed, or is given up."},
    {.name = "cycle", .read = schema_read_uint, .offset = offsetof(trigger, time.cycle),
     .arg = &cycle_range,
     .help = "The first basic cycle in which it acts. Without cycle and repeat it acts in all of "
             "them."},
    {.name = "repeat", .read = schema_read_uint, .offset = offsetof(trigger, time.repeat),
     .arg = &repeat_range,
     .help = "... and in each of so many after it. Default: once in the matrix."},
    {.name = "send", .read = cfg_read_frame, .offset = offsetof(trigger, time.frame),
     .required = true},
    {.name = "window", .read = schema_read_choice, .offset = offsetof(trigger, window),
     .arg = windows,
     .preset = "exclusive",
     .help = "Whether other nodes have a trigger at the same time; for expectations."},
    {.name = NULL},
};

/* Reads a number of units, or a time, of which whole units count. */
static void read_units(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const trigger *t = object;
    uint32_t *units = schema_member(key, object);
    const cw_local_time *local = &t->node->local;
    const char *text = schema_text(self, key, value, "units of local time, or a time such as 1ms");
    cfg_time time = {0};
    uint64_t number = 0;
    if (!text)
        return;
    if (text_parse_uint(&number, text)) {
        const char *problem = text_parse_time(&time, text);
        schema_problem(self, key, value, problem);
        if (problem || local->bits == 0)
            return;
        number = (uint64_t)(text_time_fine(time, cfg_of(self)->rate) / local->unit);
    }
    if (local->bits && number >> local->bits)
        schema_complain(self, value, "%s: more than the %u bits of local-time can count: "
                        "0..%" PRIu64 " units", key->name, local->bits,
                        (UINT64_C(1) << local->bits) - 1);
    *units = (uint32_t)number;
}

/* A slot of 0 would give each frame up. Without local time there is another complaint. */
static void read_slot(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const uint32_t *units = schema_member(key, object);
    const size_t errors = self->errors->errors;
    read_units(self, key, value, object);
    if (self->errors->errors == errors && *units == 0 && ((trigger *)object)->node->local.bits)
        schema_complain(self, value, "%s: a slot lasts a unit of local time at least", key->name);
}

static const yaml_node_t *at_key(schema *self, const trigger *t, const char *key)
{
    const yaml_node_t *const value = schema_find(self, t->map, key);
    return value ? value : t->map;
}

static bool is_reference(const cfg_schedule *s, const cw_frame *frame)
{
    return cw_frame_matches(frame, &s->reference, 1);
}

/* Turns `cycle` and `repeat` into what the library takes. */
static void complete_cycle(schema *self, const cfg_schedule *s, trigger *t)
{
    cw_time_trigger *time = &t->time;
    const bool each = time->cycle == NO_CYCLE && time->repeat == 0;
    if (time->cycle == NO_CYCLE)
        time->cycle = 0;
    if (time->repeat == 0)
        time->repeat = each ? 0 : s->cycles;
    if (time->repeat && s->cycles % time->repeat)
        schema_complain(self, at_key(self, t, "repeat"), "repeat: %u does not divide the %u basic "
                        "cycles of the matrix", time->repeat, s->cycles);
    else if (time->repeat && time->cycle >= time->repeat)
        schema_complain(self, at_key(self, t, "cycle"), "cycle: there is no cycle %u of %u; they "
                        "count from 0", time->cycle, time->repeat);
    if (!each && is_reference(s, &time->frame))
        schema_complain(self, at_key(self, t, "cycle"), "cycle: the reference message goes in each "
                        "basic cycle");
    if (is_reference(s, &time->frame) && s->cycle_byte != CFG_NO_CYCLE_BYTE &&
        s->cycle_byte >= cw_frame_length(&time->frame))
        schema_complain(self, at_key(self, t, "send"), "send: a reference message without byte %u, "
                        "in which cycle-byte puts the number of the cycle", s->cycle_byte);
}

/* Reads a trigger of a schedule. */
static void read_trigger(schema *self, yaml_node_t *value, const cfg_schedule *s, trigger *t)
{
    const size_t errors = self->errors->errors;
    t->map = value;
    t->time.cycle = NO_CYCLE;
    schema_map(self, "trigger", value, trigger_keys, t);
    if (self->errors->errors == errors)
        complete_cycle(self, s, t);
    else
        t->time.cycle = t->time.repeat = 0;
}

/* Returns true when two triggers act in the same basic cycle, once at least. */
static bool meet(const cw_time_trigger *a, const cw_time_trigger *b)
{
    if (a->repeat == 0 || b->repeat == 0)
        return true;
    return a->cycle % common_divisor(a->repeat, b->repeat) ==
           b->cycle % common_divisor(a->repeat, b->repeat);
}

/* Sorts by `at`; equal ones stay in their order. */
static void sort_triggers(trigger *all, size_t count)
{
    for (size_t i = 1; i < count; i++) {
        const trigger moved = all[i];
        size_t place = i;
        for (; place > 0 && all[place - 1].time.at > moved.time.at; place--)
            all[place] = all[place - 1];
        all[place] = moved;
    }
}

/* Checks sorted triggers against each other. */
static void check_triggers(schema *self, const cfg_schedule *s, const trigger *all, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        for (size_t k = i + 1; k < count; k++) {
            const cw_time_trigger *a = &all[i].time, *b = &all[k].time;
            if (meet(a, b) && (uint64_t)a->at + a->slot > b->at)
                schema_complain(self, all[k].map, "trigger: its slot begins at %" PRIu32 ", before "
                                "the one of line %d ends", b->at,
                                (int)all[i].map->start_mark.line + 1);
        }
        if (i + 1 < count && is_reference(s, &all[i].time.frame))
            schema_complain(self, all[i + 1].map, "trigger: it comes after the one of the "
                            "reference message, which begins the next basic cycle");
    }
}

/* Reads the triggers of a node, sorts them by time, and checks that their slots do not overlap. */
static void read_triggers(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    cfg_schedule *s = &node->schedule;
    const size_t errors = self->errors->errors;
    const size_t count = schema_count(self, key, value, 0, CW_TRIGGERS_MAX);
    trigger *all = schema_alloc(self, count + 1, sizeof *all);
    s->triggers = schema_alloc(self, count + 1, sizeof *s->triggers);
    s->arbitrating = schema_alloc(self, count + 1, sizeof *s->arbitrating);
    if (!all || !s->triggers || !s->arbitrating)
        return;
    for (size_t i = 0; i < count; i++) {
        all[i].node = node;
        read_trigger(self, schema_item(self, value, i), s, &all[i]);
    }
    sort_triggers(all, count);
    if (self->errors->errors == errors)
        check_triggers(self, s, all, count);
    for (size_t i = 0; i < count; i++) {
        s->triggers[i] = all[i].time;
        s->arbitrating[i] = all[i].window == WINDOW_ARBITRATING;
        s->master = s->master || is_reference(s, &all[i].time.frame);
    }
    s->trigger_count = (uint16_t)count;
    if (self->errors->errors != errors)
        s->trigger_count = 0;
}

/* ---- Schedules ------------------------------------------------------------------------------- */

#define MEMBER(member) .offset = offsetof(cfg_node, schedule.member)
const schema_key cfg_schedule_keys[] = {
    {.name = "reference", .read = read_reference, MEMBER(reference), .required = true,
     .type = "nodeFilter",
     .help = "The frames that begin a basic cycle."},
    {.name = "cycles", .read = schema_read_uint, MEMBER(cycles), .arg = &cycles_range,
     .preset = "1",
     .help = "Basic cycles of the matrix."},
    {.name = "cycle-byte", .read = schema_read_uint, MEMBER(cycle_byte), .arg = &byte_range,
     .help = "Data byte of reference messages with the number of the cycle. Without it nodes "
             "count."},
    {.name = "triggers", .read = read_triggers, .map = trigger_keys,
     .type = TYPE_LIST_UP_TO(255, "@")},
    {.name = NULL},
};

/* Reads the filter of reference messages: one, since a matrix has one reference. */
static void read_reference(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, "a frame filter such as 123 or 100:700");
    unsigned count = 0;
    if (text)
        schema_problem(self, key, value,
                       text_parse_filters(schema_member(key, object), &count, 1, text));
}

/* Reads a schedule. It needs the local time and the mode, which are read before it. */
void cfg_read_schedule(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    node->schedule = (cfg_schedule){.cycle_byte = CFG_NO_CYCLE_BYTE, .place = cfg_place_of(value)};
    schema_read_presets(self, cfg_schedule_keys, node);
    schema_map(self, key->name, value, cfg_schedule_keys, node);
    if (node->local.bits == 0)
        schema_complain(self, value, "%s: the node needs local-time, the clock of its triggers",
                        key->name);
    if (!(node->modes & CW_MODE_TIME_TRIGGERED))
        schema_complain(self, value, "%s: the node needs time-triggered: on, so that a frame out "
                        "of its slot is never sent", key->name);
}

/* Checks the frame of a trigger against its node. One that cannot be read has been complained
 * about. */
static void check_sender(schema *self, const yaml_node_t *map, size_t node)
{
    static const schema_key key = {.name = "send"};
    const yaml_node_t *const value = schema_find(self, map, key.name);
    cw_frame frame;
    if (value && value->type == YAML_SCALAR_NODE &&
        !text_parse_frame(&frame, (const char *)value->data.scalar.value))
        cfg_check_sender(self, &key, value, &frame, node);
}

/* Returns the reference message that a node sends, or NULL. */
static const cw_frame *reference_of(const cfg_node *node)
{
    const cfg_schedule *s = &node->schedule;
    for (unsigned k = 0; k < s->trigger_count; k++)
        if (is_reference(s, &s->triggers[k].frame))
            return &s->triggers[k].frame;
    return NULL;
}

/* Warns when a former node sends the same reference message, since the two collide. */
static void check_master(schema *self, const cfg *config, const yaml_node_t *schedule, size_t node)
{
    const cw_frame *own = reference_of(&config->nodes[node]);
    for (size_t i = 0; own && i < node; i++) {
        const cw_frame *other = reference_of(&config->nodes[i]);
        if (other && other->id == own->id &&
            !((other->flags ^ own->flags) & CW_FRAME_EXTENDED)) {
            schema_warn(self, schedule, "schedule: node '%s' sends the same reference message: two "
                        "time masters need identifiers of their own", config->nodes[i].name);
            return;
        }
    }
}

/* Checks the frames of triggers. All nodes have been read from the list. */
void cfg_check_schedules(schema *self, yaml_node_t *nodes)
{
    const cfg *config = cfg_of(self);
    for (size_t i = 0; i < config->node_count; i++) {
        const yaml_node_t *const schedule =
            schema_find(self, cfg_node_map(self, nodes, i), "schedule");
        yaml_node_t *const triggers = schedule ? schema_find(self, schedule, "triggers") : NULL;
        for (unsigned k = 0; triggers && k < config->nodes[i].schedule.trigger_count; k++)
            check_sender(self, schema_item(self, triggers, k), i);
        if (triggers)
            check_master(self, config, schedule, i);
    }
}

const cfg_place *cfg_find_master(const cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++)
        if (config->nodes[i].schedule.master)
            return &config->nodes[i].schedule.place;
    return NULL;
}

bool cfg_stops_schedule(const cfg_node *node, const cw_settings *settings)
{
    return node->schedule.cycles && settings->which & CW_SET_MODES &&
           settings->modes_mask & CW_MODE_TIME_TRIGGERED &&
           !(settings->modes & CW_MODE_TIME_TRIGGERED);
}
