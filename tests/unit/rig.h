/* SPDX-License-Identifier: MIT
 *
 * rig.h - a bus for unit tests: defaults, memory, and all its events kept and comparable as text.
 *
 * Use: RIG *r = rig_new(), change nodes, rules or config, rig_start(), hand in, rig_run(), look at
 * the events. RIG frees it where the block ends; without that rig_free() does.
 */
#ifndef CANWIRE_TEST_RIG_H
#define CANWIRE_TEST_RIG_H

#include "cases.h"
#include "canwire.h"

#define BIT 160u   /* ticks of a bit at 500 kbit/s */
#define JOIN 11u   /* bits until all nodes have integrated (M10): the first SOF */
#define RIG_RULES_MAX 8
#define RIG_LINE_MAX 200
#define NODE(i) (UINT64_C(1) << (i))

typedef struct rig {
    cw_node_config nodes[CW_NODES_MAX];
    cw_rule rules[RIG_RULES_MAX];
    cw_bus_config config;
    void *memory;
    cw_bus *bus;
    cw_event *events; /* all that were polled */
    size_t count;
    size_t capacity;
} rig;

static inline rig *rig_new(unsigned nodes)
{
    rig *r = calloc(1, sizeof *r);
    assert_non_null(r);
    for (unsigned i = 0; i < CW_NODES_MAX; i++)
        r->nodes[i] = (cw_node_config){.queue = 16, .warning_limit = 96};
    r->config = (cw_bus_config){.bit_ticks = BIT, .seed = 1, .node_count = (uint8_t)nodes,
                                .inbox = 4096, .events = 4096, .nodes = r->nodes,
                                .rules = r->rules};
    return r;
}

/* Adds a flip rule on every match; the caller refines it. */
static inline cw_rule *rig_flip(rig *r, const char *name, cw_field field, unsigned index)
{
    assert_in_range(r->config.rule_count, 0, RIG_RULES_MAX - 1);
    cw_rule *rule = &r->rules[r->config.rule_count++];
    *rule = (cw_rule){.name = name, .time_end = CW_NEVER, .probability = UINT64_MAX, .every = 1,
                      .action = CW_ACTION_FLIP, .field = field, .index = (uint16_t)index,
                      .bits = 1};
    return rule;
}

static inline void rig_start(rig *r)
{
    size_t size = cw_bus_size(&r->config);
    assert_int_not_equal(size, 0);
    r->memory = malloc(size);
    assert_non_null(r->memory);
    r->bus = cw_bus_init(r->memory, &r->config);
    assert_non_null(r->bus);
}

static inline void rig_free(rig *r)
{
    free(r->memory);
    free(r->events);
    free(r);
}

#define RIG __attribute__((cleanup(rig_end))) rig
static inline void rig_end(rig **r)
{
    rig_free(*r);
}

static inline void rig_poll(rig *r)
{
    cw_event event;
    while (cw_bus_poll(r->bus, &event)) {
        if (r->count == r->capacity) {
            r->capacity = r->capacity ? 2 * r->capacity : 256;
            r->events = realloc(r->events, r->capacity * sizeof *r->events);
            assert_non_null(r->events);
        }
        r->events[r->count++] = event;
    }
}

static inline void rig_run(rig *r, uint64_t tick)
{
    while (cw_bus_advance(r->bus, tick) == CW_FULL)
        rig_poll(r);
    rig_poll(r);
}

static inline void rig_run_bits(rig *r, uint64_t bits)
{
    rig_run(r, bits * BIT);
}

/* Runs up to a tick; no frame is received or sent before the tick of cw_bus_next(). */
static inline void rig_run_by_next(rig *r, uint64_t end)
{
    while (cw_bus_next(r->bus) != CW_NEVER && cw_bus_now(r->bus) < end) {
        uint64_t next = cw_bus_next(r->bus);
        size_t before = r->count;
        rig_run(r, next > cw_bus_now(r->bus) + BIT ? next : cw_bus_now(r->bus) + BIT);
        for (size_t i = before; i < r->count; i++)
            if (r->events[i].kind == CW_EVENT_RX || r->events[i].kind == CW_EVENT_TX)
                assert_true(r->events[i].tick >= next);
    }
}

static inline void rig_send(rig *r, unsigned node, const cw_frame *frame, uint64_t tick)
{
    assert_int_equal(cw_node_send(r->bus, node, frame, tick), CW_OK);
}

/* Returns a frame, by default a base frame; the data bytes are 11 22 33 ... */
static inline cw_frame rig_frame(uint32_t id, unsigned flags, unsigned dlc)
{
    cw_frame f = {.id = id, .flags = (uint8_t)flags, .dlc = (uint8_t)dlc};
    for (unsigned i = 0; i < cw_frame_length(&f); i++)
        f.data[i] = (uint8_t)(0x11 * (i + 1));
    return f;
}

static inline cw_node_stats rig_stats(const rig *r, unsigned node)
{
    cw_node_stats stats;
    assert_int_equal(cw_node_get_stats(r->bus, node, &stats), CW_OK);
    return stats;
}

static inline cw_bus_stats rig_bus_stats(const rig *r)
{
    cw_bus_stats stats;
    cw_bus_get_stats(r->bus, &stats);
    return stats;
}

/* Events of a kind so far, of one node or (node < 0) of all. */
static inline size_t rig_count(const rig *r, cw_event_kind kind, int node)
{
    size_t n = 0;
    for (size_t i = 0; i < r->count; i++)
        n += r->events[i].kind == kind && (node < 0 || r->events[i].nodes >> node & 1u);
    return n;
}

/* Returns the n-th event of a kind, of any node; the test fails when there is none. */
static inline const cw_event *rig_nth(const rig *r, cw_event_kind kind, size_t n)
{
    for (size_t i = 0; i < r->count; i++)
        if (r->events[i].kind == kind && n-- == 0)
            return &r->events[i];
    fail_msg("no such %s event among %zu", cw_event_name(kind), r->count);
    return NULL;
}

/* ---- Events as text -------------------------------------------------------------------------- */

static inline void rig_append(char *line, const char *format, ...)
{
    va_list arguments;
    size_t used = strlen(line);
    va_start(arguments, format);
    vsnprintf(line + used, RIG_LINE_MAX - used, format, arguments);
    va_end(arguments);
}

static inline void rig_append_frame(char *line, const cw_frame *f)
{
    rig_append(line, f->flags & CW_FRAME_EXTENDED ? " %08X#" : " %03X#", f->id);
    rig_append(line, f->flags & CW_FRAME_REMOTE ? "R%u" : "%u:", f->dlc);
    for (unsigned i = 0; i < cw_frame_length(f); i++)
        rig_append(line, "%02X", f->data[i]);
}

static inline void rig_append_error(char *line, const cw_event *e)
{
    rig_append(line, " %s %s %s[%u]%s %s", e->error.role == CW_ROLE_TRANSMITTER ? "tx" : "rx",
               cw_error_type_name(e->error.type), cw_field_name(e->error.place.field),
               e->error.place.index, e->error.place.stuff ? "s" : "", cw_flag_name(e->error.flag));
}

/* Prints "TICK MASK KIND ..." with all details of the kind. */
static inline void rig_line(char *line, const cw_event *e)
{
    snprintf(line, RIG_LINE_MAX, "%llu %llx %s", (unsigned long long)e->tick,
             (unsigned long long)e->nodes, cw_event_name(e->kind));
    if (e->kind == CW_EVENT_ERROR)
        rig_append_error(line, e);
    if (e->kind == CW_EVENT_STATE)
        rig_append(line, " %s %s", cw_state_name(e->state_before), cw_state_name(e->state));
    if (e->kind == CW_EVENT_ERROR || e->kind == CW_EVENT_STATE)
        rig_append(line, " %u/%u", e->tec, e->rec);
    if (e->kind == CW_EVENT_FAULT)
        rig_append(line, " %u %u", e->rule, e->hit);
    if (e->kind == CW_EVENT_DROP)
        rig_append(line, " %s", cw_drop_name(e->why));
    if (e->kind == CW_EVENT_LINK)
        rig_append(line, " %s", e->up ? "up" : "down");
    if (e->kind == CW_EVENT_ARBITRATION_LOST)
        rig_append(line, " %u", e->lost_bit);
    if (e->kind == CW_EVENT_DROP || e->kind == CW_EVENT_ARBITRATION_LOST ||
        e->kind == CW_EVENT_RX || e->kind == CW_EVENT_TX)
        rig_append_frame(line, &e->frame);
}

static inline void rig_assert_same_events(const rig *a, const rig *b)
{
    char left[RIG_LINE_MAX];
    char right[RIG_LINE_MAX];
    for (size_t i = 0; i < a->count && i < b->count; i++) {
        rig_line(left, &a->events[i]);
        rig_line(right, &b->events[i]);
        assert_string_equal(left, right);
    }
    assert_int_equal(a->count, b->count);
}

/* ---- Random numbers that are the same in every run ------------------------------------------- */

typedef struct rig_random {
    uint64_t state; /* not 0 */
} rig_random;

static inline uint32_t rig_next(rig_random *r)
{
    r->state ^= r->state << 13;
    r->state ^= r->state >> 7;
    r->state ^= r->state << 17;
    return (uint32_t)(r->state >> 32);
}

static inline uint32_t rig_below(rig_random *r, uint32_t limit)
{
    return rig_next(r) % limit;
}

/* Draws random bits in runs, so that stuff bits are frequent. */
static inline uint32_t rig_runs(rig_random *r)
{
    static const uint32_t patterns[] = {0, 0xFFFFFFFF, 0x1F1F1F1F, 0xF0F0F0F0, 0x07C1F07C};
    uint32_t pick = rig_below(r, 8);
    return pick < 5 ? patterns[pick] >> rig_below(r, 5) : rig_next(r);
}

/* Draws any valid classical frame. */
static inline cw_frame rig_random_frame(rig_random *r)
{
    cw_frame f = {.flags = (uint8_t)rig_below(r, 2), .dlc = (uint8_t)rig_below(r, 16)};
    if (rig_below(r, 5) == 0)
        f.flags |= CW_FRAME_REMOTE;
    f.id = rig_runs(r) & (f.flags & CW_FRAME_EXTENDED ? 0x1FFFFFFFu : 0x7FFu);
    for (unsigned i = 0; i < cw_frame_length(&f); i++)
        f.data[i] = (uint8_t)rig_runs(r);
    return f;
}

#endif
