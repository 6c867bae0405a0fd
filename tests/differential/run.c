/* SPDX-License-Identifier: MIT
 *
 * run.c - a scenario on two buses, the fast one and the reference.
 *
 * Both advance to the tick of an operation in slices of their own. Their events are taken and
 * compared, then both get the same operation.
 */
#include "differential.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define CONTEXT 8u /* events shown before and after the first one that differs */

typedef struct side {
    const char *name;
    cw_bus *bus;
    void *memory;
    diff_slicing slicing;
    diff_random random;
    bool peeks;
    cw_event *events; /* since the last operation */
    size_t count;
    size_t room;
    bool drained;  /* the ring has no events */
    bool second;   /* records[1] are those of the bus, else records[0] */
    cw_sync_record records[2][CW_NODES_MAX];
    bool counts; /* synchronisations, in the records */
    uint64_t full; /* times that the ring was full */
} side;

typedef struct pair {
    const diff_scenario *scenario;
    diff_scenario plans; /* a copy, to fill in */
    diff_coverage *coverage;
    FILE *out;
    diff_verdict *verdict;
    diff_ledger *ledger;
    side fast;
    side reference;
    uint32_t bit_ticks;
    uint32_t unseen;     /* kinds of events that have been left out at some time */
    unsigned rule_count; /* indices of rules that may be in use */
    cw_rule rules[2 * DIFF_RULES_MAX];
    cw_event history[CONTEXT];
    uint64_t events; /* compared so far */
    bool own_clocks;
} pair;

/* ---- What differs ---------------------------------------------------------------------------- */

static void found(pair *p, uint64_t tick)
{
    if (p->verdict->differs)
        return;
    p->verdict->differs = true;
    p->verdict->tick = tick;
}

static void write_side(const side *s, size_t from, FILE *out)
{
    fprintf(out, "%s:\n", s->name);
    if (from >= s->count)
        fprintf(out, "  no further event up to tick %" PRIu64 "\n", cw_bus_now(s->bus));
    for (size_t i = from; i < s->count && i < from + CONTEXT; i++)
        diff_write_event(out, &s->events[i]);
}

static void write_event_difference(const pair *p, size_t at)
{
    FILE *out = p->out;
    fprintf(out, "event %" PRIu64 " differs; before it:\n", p->events + at);
    for (uint64_t i = p->events > CONTEXT ? p->events - CONTEXT : 0; i < p->events; i++)
        if (i + CONTEXT >= p->events + at)
            diff_write_event(out, &p->history[i % CONTEXT]);
    for (size_t i = at > CONTEXT ? at - CONTEXT : 0; i < at; i++)
        diff_write_event(out, &p->reference.events[i]);
    write_side(&p->fast, at, out);
    write_side(&p->reference, at, out);
}

static uint64_t event_tick(const side *s, size_t at)
{
    return at < s->count ? s->events[at].tick : CW_NEVER;
}

static void events_differ(pair *p, size_t at)
{
    uint64_t a = event_tick(&p->fast, at);
    uint64_t b = event_tick(&p->reference, at);
    if (p->out)
        write_event_difference(p, at);
    found(p, a < b ? a : b);
}

static void statuses_same(pair *p, const char *what, cw_status fast, cw_status reference)
{
    p->coverage->refusals[fast]++;
    if (fast == reference)
        return;
    if (p->out)
        fprintf(p->out, "status of %s: fast %d, reference %d\n", what, (int)fast, (int)reference);
    found(p, cw_bus_now(p->reference.bus));
}

/* ---- Events ---------------------------------------------------------------------------------- */

static void take_events(side *s, size_t most)
{
    cw_event e;
    for (; most > 0 && cw_bus_poll(s->bus, &e); most--) {
        if (s->count == s->room) {
            s->room = s->room ? 2 * s->room : 256;
            s->events = diff_allocate(s->events, s->room * sizeof s->events[0]);
        }
        s->events[s->count++] = e;
    }
}

static const cw_rule *rule_of(const pair *p, const cw_event *e)
{
    bool known = e->kind == CW_EVENT_FAULT && e->rule < p->rule_count;
    return known ? &p->rules[e->rule] : NULL;
}

static void compare_events(pair *p)
{
    size_t most = p->fast.count > p->reference.count ? p->fast.count : p->reference.count;
    if (p->verdict->differs)
        return;
    for (size_t i = 0; i < most; i++) {
        bool both = i < p->fast.count && i < p->reference.count;
        if (!both || !diff_same_event(&p->fast.events[i], &p->reference.events[i])) {
            events_differ(p, i);
            return;
        }
        diff_cover_event(p->coverage, &p->fast.events[i], rule_of(p, &p->fast.events[i]));
        diff_ledger_event(p->ledger, &p->fast.events[i]);
    }
    for (size_t i = most > CONTEXT ? most - CONTEXT : 0; i < most; i++)
        p->history[(p->events + i) % CONTEXT] = p->fast.events[i];
    p->events += most;
    p->fast.count = 0;
    p->reference.count = 0;
}

/* ---- Advance --------------------------------------------------------------------------------- */

static uint64_t slice_end(pair *p, side *s, uint64_t target)
{
    uint64_t now = cw_bus_now(s->bus);
    uint64_t left = target > now ? target - now : 0;
    uint64_t ticks = left;
    switch (s->slicing) {
    case DIFF_BITS:
        ticks = cw_bus_tick_after(s->bus, 1) - now;
        break;
    case DIFF_SHORT:
        ticks = diff_between(&s->random, 1, 12 * (uint64_t)p->bit_ticks);
        break;
    case DIFF_MIXED:
        if (left >= 2 * (uint64_t)p->bit_ticks || diff_chance(&s->random, 500))
            ticks = left ? diff_magnitude(&s->random, 1, left) : 0;
        break;
    case DIFF_NEXT:
        ticks = cw_bus_next(s->bus);
        ticks = ticks > now + p->bit_ticks ? ticks - now : p->bit_ticks;
        break;
    case DIFF_WHOLE:
    case DIFF_WORK:
    case DIFF_SLICING_COUNT:
        break;
    }
    return ticks < left ? now + ticks : target;
}

/* Events that come by themselves; after anything else they may come as they like. */
static bool is_foreseeable(const cw_event *e)
{
    return e->kind == CW_EVENT_RX || e->kind == CW_EVENT_TX || e->kind == CW_EVENT_RESTART;
}

/* Checks that frames and restarts do not come before the tick of cw_bus_next(), unless something
 * unforeseen happens. Nothing comes when it has reported a resting bus. */
static void check_next(pair *p, const side *s, size_t from, uint64_t next)
{
    cw_data_stats data;
    const bool rates = cw_node_get_data_stats(s->bus, 0, &data) == CW_OK;
    const bool common = cw_bus_is_on_grid(s->bus) && !rates;
    if (next != CW_NEVER && !common) /* it may come earlier in the bit time */
        next = next > p->bit_ticks ? next - p->bit_ticks : 0;
    const uint32_t unforeseen = ~(1u << CW_EVENT_ARBITRATION_LOST);
    for (size_t i = from; i < s->count; i++) {
        const cw_event *e = &s->events[i];
        if (e->kind == CW_EVENT_SYNC || (e->kind == CW_EVENT_ARBITRATION_LOST && next != CW_NEVER))
            continue;
        if (e->tick >= next || (next != CW_NEVER && p->unseen & unforeseen))
            return;
        if (next != CW_NEVER && !is_foreseeable(e))
            return;
        if (p->out) {
            fprintf(p->out, "%s: cw_bus_next() was %" PRIu64 ", but:\n", s->name, next);
            diff_write_event(p->out, e);
        }
        found(p, e->tick);
        return;
    }
}

/* A test for cw_bus_next_rx(). */
static bool is_odd(const void *user, unsigned node, const cw_frame *frame)
{
    (void)user;
    return (frame->id & 1u) && node != 1;
}

static bool has_rules(const pair *p, const side *s)
{
    cw_rule_stats stats;
    bool has = false;
    for (unsigned i = 0; !has && i < p->rule_count; i++)
        has = cw_rule_get_stats(s->bus, i, &stats) == CW_OK;
    return has;
}

/* Checks that no such frame is received before a tick, whatever errors come. Rules may send any. */
static void check_next_rx(pair *p, const side *s, size_t from, uint64_t next)
{
    cw_data_stats data;
    const bool rates = cw_node_get_data_stats(s->bus, 0, &data) == CW_OK;
    if (next != CW_NEVER && (!cw_bus_is_on_grid(s->bus) || rates))
        next = next > p->bit_ticks ? next - p->bit_ticks : 0;
    for (size_t i = from; i < s->count && !has_rules(p, s); i++) {
        const cw_event *e = &s->events[i];
        p->coverage->marks[DIFF_FORETOLD] += next != 0;
        if (e->kind != CW_EVENT_RX || !is_odd(NULL, e->from == 2u ? 1 : 0, &e->frame) ||
            e->tick >= next)
            continue;
        if (p->out) {
            fprintf(p->out, "%s: cw_bus_next_rx() was %" PRIu64 ", but:\n", s->name, next);
            diff_write_event(p->out, e);
        }
        found(p, e->tick);
    }
}

/* Reads the state of a bus, which must change nothing. */
static void peek(const side *s)
{
    cw_node_stats node;
    cw_bus_stats bus;
    cw_settings settings;
    cw_bus_get_stats(s->bus, &bus);
    (void)cw_bus_next(s->bus);
    (void)cw_bus_next_rx(s->bus, is_odd, NULL);
    (void)cw_bus_idle(s->bus);
    for (unsigned i = 0; cw_node_get_stats(s->bus, i, &node) == CW_OK; i++)
        (void)cw_node_get_settings(s->bus, i, &settings);
}

/* Advances by limited work, at least one bit in each call, sometimes with an end. */
static cw_status advance_once(pair *p, side *s, uint64_t end)
{
    if (s->slicing != DIFF_WORK)
        return cw_bus_advance(s->bus, end);
    uint64_t before = cw_bus_now(s->bus);
    uint64_t work = diff_magnitude(&s->random, 1, 1000) - 1;
    cw_status status = cw_bus_advance_some(s->bus, end, work);
    if (status == CW_AGAIN && cw_bus_now(s->bus) == before)
        found(p, before);
    p->coverage->refusals[status]++;
    return status;
}

/* Advances by one call, and by more while the ring is full or work is left. Returns false when it
 * does not go on. */
static bool advance_through(pair *p, side *s, uint64_t end)
{
    cw_status status;
    while ((status = advance_once(p, s, end)) != CW_OK && !p->verdict->differs) {
        size_t had = s->count;
        if (status == CW_AGAIN && diff_chance(&s->random, 500))
            continue;
        s->full += status == CW_FULL;
        take_events(s,
                    s->slicing == DIFF_WHOLE ? SIZE_MAX : (size_t)diff_between(&s->random, 1, 300));
        if (s->count == had && status == CW_FULL)
            return false;
    }
    return cw_bus_now(s->bus) >= end || cw_bus_tick_after(s->bus, 1) > end;
}

static void drain(pair *p, side *s, size_t before, uint64_t next, uint64_t next_rx)
{
    take_events(s, SIZE_MAX);
    s->drained = true;
    check_next(p, s, before, next);
    check_next_rx(p, s, before, next_rx);
}

static void advance_slice(pair *p, side *s, uint64_t end)
{
    size_t before = s->count;
    uint64_t next = s->drained ? cw_bus_next(s->bus) : 0;
    uint64_t next_rx = s->drained ? cw_bus_next_rx(s->bus, is_odd, NULL) : 0;
    s->drained = false;
    if (!advance_through(p, s, end)) {
        if (p->out)
            fprintf(p->out, "%s does not go on to tick %" PRIu64 "\n", s->name, end);
        found(p, cw_bus_now(s->bus));
    }
    if (diff_chance(&s->random, p->scenario->drains))
        drain(p, s, before, next, next_rx);
    if (s->peeks)
        peek(s);
}

static void advance_side(pair *p, side *s, uint64_t target)
{
    uint64_t end;
    /* the same slices whatever came before, so that operations can be left out */
    diff_random_init(&s->random, cw_bus_now(s->bus) ^ target << 20);
    do {
        end = slice_end(p, s, target);
        advance_slice(p, s, end);
    } while (!p->verdict->differs && end < target);
}

/* Takes all events up to now. */
static void settle(pair *p)
{
    drain(p, &p->fast, p->fast.count, 0, 0);
    drain(p, &p->reference, p->reference.count, 0, 0);
    compare_events(p);
}

/* The result of a look ahead. */
typedef struct foreseen {
    uint32_t kinds; /* that have always been kept; 0: nothing to compare with */
    uint64_t tick;
    size_t from; /* the first event that was to come */
} foreseen;

/* Looks ahead, which must change nothing. */
static foreseen look_ahead(pair *p, side *s, uint64_t until)
{
    const bool all_taken = cw_bus_peek(s->bus).count == 0;
    const uint32_t drawn = (uint32_t)diff_between(&s->random, 1, CW_EVENTS_USUAL);
    foreseen f = {.kinds = drawn & CW_EVENTS_USUAL & ~p->unseen, .from = s->count};
    void *copy = diff_allocate(NULL, cw_bus_copy_size(s->bus));
    f.tick = cw_bus_next_event(s->bus, copy, f.kinds, until);
    free(copy);
    if (!all_taken)
        f.kinds = 0;
    return f;
}

/* Checks that the first event of these kinds has come at that tick. */
static void check_foreseen(pair *p, const side *s, const foreseen *f)
{
    const cw_event_row row = cw_bus_peek(s->bus);
    const size_t taken = s->count - f->from;
    for (size_t i = 0; i < taken + row.count && f->kinds; i++) {
        const cw_event *e = i < taken ? &s->events[f->from + i]
                                      : cw_event_at(&row, (unsigned)(i - taken));
        if (!(f->kinds >> e->kind & 1u))
            continue;
        if (e->tick != f->tick)
            found(p, e->tick);
        p->coverage->marks[DIFF_FORESEEN]++;
        return;
    }
    if (f->kinds && row.count == 0 && f->tick != CW_NEVER)
        found(p, f->tick);
}

/* Advances, with a look ahead before it where the scenario has it. */
static void advance_foreseen(pair *p, side *s, uint64_t tick)
{
    foreseen f = {.kinds = 0};
    diff_random_init(&s->random, cw_bus_now(s->bus) ^ tick << 20);
    if (p->scenario->peeks)
        f = look_ahead(p, s, tick);
    advance_side(p, s, tick);
    if (!p->verdict->differs)
        check_foreseen(p, s, &f);
    if (p->verdict->differs && p->out && f.kinds)
        fprintf(p->out, "%s: cw_bus_next_event() of 0x%x was %" PRIu64 "\n", s->name, f.kinds,
                f.tick);
}

/* The fast bus stops at any tick. The reference goes there, or to the end of the bit at which the
 * fast one has stopped, which a journal has. That is the same. */
static void advance(pair *p, uint64_t tick)
{
    advance_foreseen(p, &p->fast, tick);
    advance_foreseen(p, &p->reference, p->scenario->repeats ? cw_bus_now(p->fast.bus) : tick);
    if (p->scenario->drains)
        settle(p);
    if (cw_bus_now(p->fast.bus) == cw_bus_now(p->reference.bus) || p->verdict->differs)
        return;
    if (p->out)
        fprintf(p->out, "the fast bus has stopped at %" PRIu64 ", the reference at %" PRIu64 "\n",
                cw_bus_now(p->fast.bus), cw_bus_now(p->reference.bus));
    found(p, cw_bus_now(p->reference.bus));
}

static void check(pair *p)
{
    cw_bit_view unused;
    p->coverage->marks[DIFF_COMPARISONS]++;
    p->coverage->marks[DIFF_SHORT_CUTS] += cw_bus_get_bit(p->fast.bus, &unused) != CW_OK;
    const bool bits = diff_same_bits(p->fast.bus, p->reference.bus, p->out);
    if (!bits || !diff_same_buses(p->fast.bus, p->reference.bus, p->rule_count, p->out) ||
        (p->fast.drained && p->reference.drained &&
         !diff_ledger_check(p->ledger, p->reference.bus, p->out)))
        found(p, cw_bus_now(p->reference.bus));
}

/* ---- Buses ----------------------------------------------------------------------------------- */

/* Returns true when rules need room in queues that a bus without rules does not have. */
static bool needs_rules(const cw_bus_config *config)
{
    for (unsigned i = 0; i < config->rule_count; i++)
        if (config->rules[i].action == CW_ACTION_SET)
            return true;
    return false;
}

static cw_bus *with_rules(cw_bus *bus, const cw_bus_config *config)
{
    unsigned index;
    for (unsigned i = 0; i < config->rule_count; i++)
        if (cw_bus_add_rule(bus, &index, &config->rules[i]) != CW_OK)
            return NULL;
    return bus;
}

/* Leaves traces of frames and rules in all that a bus has. */
static void use(cw_bus *bus, const cw_bus_config *config)
{
    cw_event event;
    const uint64_t end = 400u * config->bit_ticks;
    for (unsigned i = 0; i < 4u * config->node_count; i++) {
        const cw_frame frame = {.id = 0x100 + 37 * i, .dlc = (uint8_t)(i % 9)};
        (void)cw_node_send(bus, i % config->node_count, &frame, i * 20u * config->bit_ticks);
    }
    cw_bus_set_watching(bus, true);
    while (cw_bus_advance(bus, end) == CW_FULL)
        while (cw_bus_poll(bus, &event))
            continue;
}

/* Makes a bus that has been in use, and begins again. */
static cw_bus *begin_again(void *memory, const cw_bus_config *config)
{
    cw_bus_config bare = *config;
    bare.seed = ~config->seed;
    bare.rule_room = (uint16_t)(config->rule_room + config->rule_count);
    bare.rule_count = 0;
    cw_bus *bus = cw_bus_init(memory, &bare);
    if (!bus)
        return NULL;
    void *start = diff_allocate(NULL, cw_bus_copy_size(bus));
    cw_bus_copy(bus, start);
    if (with_rules(bus, config))
        use(bus, config);
    cw_bus_begin_again(bus, start, config->seed);
    free(start);
    return with_rules(bus, config);
}

/* Makes a bus. Nothing may depend on the earlier contents of the memory, which differ for the
 * two. */
static void *make_bus(cw_bus **bus, const cw_bus_config *config, int filling)
{
    size_t size = cw_bus_size(config);
    *bus = NULL;
    if (size == 0)
        return NULL;
    void *memory = diff_allocate(NULL, size);
    memset(memory, filling, size);
    const bool again = filling == 'f' && config->seed % 2 == 0 && !needs_rules(config);
    *bus = again ? begin_again(memory, config) : cw_bus_init(memory, config);
    if (*bus)
        return memory;
    free(memory);
    return NULL;
}

static void know_rules(pair *p, const cw_bus_config *config)
{
    p->rule_count = (unsigned)config->rule_count + config->rule_room;
    memset(p->rules, 0, sizeof p->rules);
    for (unsigned i = 0; i < config->rule_count; i++)
        p->rules[i] = config->rules[i];
}

static cw_status side_take_over(side *s, const cw_bus_config *config, const uint8_t *from)
{
    cw_bus *bus;
    void *memory = make_bus(&bus, config, s->name[0]);
    if (!bus)
        return CW_REFUSED;
    if (s->counts)
        cw_bus_set_sync_records(bus, s->records[!s->second]);
    cw_status status = cw_bus_take_over(bus, s->bus, from);
    if (status == CW_OK) {
        free(s->memory);
        s->second = !s->second;
        s->memory = memory;
        s->bus = bus;
    } else {
        free(memory);
    }
    return status;
}

static void set_reference(pair *p)
{
    cw_bus_set_stepping(p->reference.bus, true);
    cw_bus_set_own_clocks(p->reference.bus, p->own_clocks);
}

static void take_over(pair *p, const diff_op *op)
{
    cw_rule rules[DIFF_RULES_MAX];
    const cw_bus_config *config = diff_fill_in(&p->plans.plans[op->target], rules);
    cw_status status = side_take_over(&p->fast, config, op->from);
    statuses_same(p, "take-over", status, side_take_over(&p->reference, config, op->from));
    set_reference(p);
    if (status != CW_OK)
        return;
    know_rules(p, config);
    diff_ledger_take_over(p->ledger, op->from, config->node_count);
}

/* ---- Operations ------------------------------------------------------------------------------ */

static void add_rule(pair *p, const diff_op *op)
{
    unsigned a = 0;
    unsigned b = 0;
    cw_rule rule = p->scenario->added[op->target].rule;
    rule.name = diff_name(p->scenario->added[op->target].name);
    cw_status status = cw_bus_add_rule(p->fast.bus, &a, &rule);
    statuses_same(p, "cw_bus_add_rule", status, cw_bus_add_rule(p->reference.bus, &b, &rule));
    if (a != b)
        found(p, cw_bus_now(p->reference.bus));
    if (status == CW_OK && a < p->rule_count)
        p->rules[a] = rule;
}

#define BOTH(call, ...)                                                                            \
    statuses_same(p, #call, call(p->fast.bus, __VA_ARGS__), call(p->reference.bus, __VA_ARGS__))

static void send(pair *p, const diff_op *op)
{
    const cw_frame *frame = &op->send.frame;
    cw_status status = cw_node_send(p->fast.bus, op->target, frame, op->send.at_tick);
    statuses_same(p, "cw_node_send", status,
                  cw_node_send(p->reference.bus, op->target, frame, op->send.at_tick));
    if (status == CW_OK)
        diff_ledger_send(p->ledger, op->target, frame);
}

static void operate(pair *p, const diff_op *op)
{
    p->coverage->ops[op->kind]++;
    switch (op->kind) {
    case DIFF_SEND:
        send(p, op);
        break;
    case DIFF_RESTART:
        BOTH(cw_node_restart, op->target);
        break;
    case DIFF_ADD_RULE:
        add_rule(p, op);
        break;
    case DIFF_CLEAR_RULE:
        BOTH(cw_bus_clear_rule, op->target);
        break;
    case DIFF_STOP_RULE:
        BOTH(cw_bus_stop_rule, op->target);
        break;
    case DIFF_FIRE_RULE:
        BOTH(cw_bus_fire_rule, op->target);
        break;
    case DIFF_SET:
        BOTH(cw_node_set, op->target, &op->settings);
        break;
    case DIFF_FLUSH:
        BOTH(cw_node_flush, op->target);
        break;
    case DIFF_ATTACH:
        BOTH(cw_node_attach, op->target, op->on);
        break;
    case DIFF_SET_EVENTS:
        p->unseen |= ~op->kinds;
        if (p->unseen & (1u << CW_EVENT_TX | 1u << CW_EVENT_DROP))
            diff_ledger_close(p->ledger);
        cw_bus_set_events(p->fast.bus, op->kinds);
        cw_bus_set_events(p->reference.bus, op->kinds);
        break;
    case DIFF_TAKE_OVER:
        take_over(p, op);
        break;
    case DIFF_BRING_FORWARD:
        cw_bus_bring_forward(p->fast.bus, op->ticks);
        cw_bus_bring_forward(p->reference.bus, op->ticks);
        break;
    case DIFF_STEPPING:
        cw_bus_set_stepping(p->fast.bus, op->on);
        break;
    case DIFF_WATCHING:
        cw_bus_set_watching(p->fast.bus, op->on);
        break;
    case DIFF_CHECK:
    case DIFF_OP_COUNT:
        check(p);
        break;
    }
}

/* Returns true for a frame for later, which changes nothing yet. All other operations may cause
 * events at the present tick, whose order depends on the events already taken: all have been. */
static bool is_for_later(const pair *p, const diff_op *op)
{
    return op->kind == DIFF_SEND && op->send.at_tick > cw_bus_now(p->reference.bus);
}

static void run_operation(pair *p, const diff_op *op)
{
    if (!op->at_once)
        advance(p, op->tick);
    if (!is_for_later(p, op))
        settle(p);
    if (p->verdict->differs)
        return;
    operate(p, op);
    if (op->kind != DIFF_SEND)
        settle(p);
}

/* Flushes all frames; returns true when the ring had room for all events. */
static bool flush_all(side *s)
{
    cw_node_stats stats;
    for (unsigned i = 0; cw_node_get_stats(s->bus, i, &stats) == CW_OK; i++) {
        take_events(s, SIZE_MAX);
        if (cw_node_flush(s->bus, i) != CW_OK)
            return false;
    }
    return true;
}

/* Checks the event of each frame. */
static void settle_ledger(pair *p)
{
    bool flushed = flush_all(&p->fast);
    if (!flush_all(&p->reference) || !flushed)
        found(p, cw_bus_now(p->reference.bus));
    settle(p);
    if (!p->verdict->differs && !diff_ledger_check_end(p->ledger, p->reference.bus, p->out))
        found(p, cw_bus_now(p->reference.bus));
    if (!p->verdict->differs)
        check(p);
}

static void run_operations(pair *p)
{
    const diff_scenario *s = p->scenario;
    for (unsigned i = 0; i < s->op_count && !p->verdict->differs; i++)
        run_operation(p, &s->ops[i]);
    if (!p->verdict->differs)
        advance(p, s->end);
    settle(p);
    if (!p->verdict->differs)
        check(p);
    if (!p->verdict->differs)
        settle_ledger(p);
}

/* ---- Run ------------------------------------------------------------------------------------- */

static void count(pair *p)
{
    cw_bus_stats stats;
    cw_bus_get_stats(p->reference.bus, &stats);
    p->coverage->scenarios++;
    p->coverage->bits += stats.bits;
    p->coverage->frames += stats.frames;
    p->coverage->error_frames += stats.error_frames;
    for (unsigned i = 0; i < p->scenario->plan_count; i++)
        p->coverage->marks[DIFF_FULL_BUSES] +=
            p->scenario->plans[i].config.node_count == CW_NODES_MAX;
    p->coverage->style_bits[p->scenario->style] += stats.bits;
    p->coverage->style_frames[p->scenario->style] += stats.frames;
    p->coverage->marks[DIFF_FULL_RINGS] += p->fast.full;
}

/* Makes the bus of a side. counts: synchronisations. */
static bool start(side *s, const char *name, const cw_bus_config *config, bool counts)
{
    s->name = name;
    s->counts = counts;
    s->drained = true;
    s->memory = make_bus(&s->bus, config, name[0]);
    if (s->bus && counts)
        cw_bus_set_sync_records(s->bus, s->records[0]);
    return s->bus != NULL;
}

static void end_side(side *s)
{
    free(s->memory);
    free(s->events);
}

/* Returns true when an operation is what no bus may have that keeps its setup. */
static bool changes_setup(const diff_scenario *s, const diff_op *op)
{
    const uint32_t later = CW_SET_CLOCKS | CW_SET_SLEEP | CW_SET_WAKE;
    return op->kind == DIFF_TAKE_OVER || (op->kind == DIFF_SET && (op->settings.which & later)) ||
           (op->kind == DIFF_ADD_RULE && !cw_rule_keeps_setup(&s->added[op->target].rule));
}

/* Returns true when the fast bus keeps its setup: in half of the scenarios that allow it. */
static bool keeps_setup(const diff_scenario *s)
{
    bool keeps = s->seed / 2 % 2 == 0;
    for (unsigned i = 0; i < s->plans[0].config.node_count; i++)
        keeps = keeps && s->plans[0].nodes[i].sleep.filter_ticks == 0 &&
                  s->plans[0].nodes[i].sleep.wake_ticks == 0 &&
                  s->plans[0].nodes[i].sleep.frame_count == 0;
    for (unsigned i = 0; i < s->op_count; i++)
        keeps = keeps && !changes_setup(s, &s->ops[i]);
    return keeps;
}

void diff_run(diff_verdict *v, const diff_scenario *s, diff_coverage *c, FILE *out)
{
    cw_rule rules[DIFF_RULES_MAX];
    pair *p = diff_allocate(NULL, sizeof *p);
    memset(p, 0, sizeof *p);
    *v = (diff_verdict){.differs = false};
    p->scenario = s;
    p->plans = *s;
    p->coverage = c;
    p->out = out;
    p->verdict = v;
    const cw_bus_config *config = diff_fill_in(&p->plans.plans[0], rules);
    const bool counts = p->scenario->seed % 2;
    p->plans.plans[0].config.keeps_setup = keeps_setup(s);
    bool started = start(&p->fast, "fast", config, counts);
    p->plans.plans[0].config.keeps_setup = false;
    started = start(&p->reference, "reference", config, counts) && started;
    if (started) {
        p->bit_ticks = config->bit_ticks;
        p->fast.slicing = s->fast;
        p->fast.peeks = s->peeks;
        p->reference.slicing = s->reference;
        p->own_clocks = s->own_clocks;
        set_reference(p);
        know_rules(p, config);
        p->ledger = diff_ledger_new(s);
        run_operations(p);
        diff_ledger_free(p->ledger);
        count(p);
    }
    end_side(&p->fast);
    end_side(&p->reference);
    free(p);
}
