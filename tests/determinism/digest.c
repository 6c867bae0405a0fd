/* SPDX-License-Identifier: MIT
 *
 * digest.c - one number for all results of random scenarios. It must be the same for each compiler,
 * optimisation and width of a machine word.
 *
 * usage: digest [BITS [SEED]]
 *
 * The scenarios are those of the differential test, with the seeds from SEED on, for BITS bits in
 * all. Events, statistics and states are hashed instead of compared. It prints a line for each
 * scenario.
 */
#include "../differential/differential.h"

#include <inttypes.h>
#include <stdlib.h>

#define BITS_DEFAULT UINT64_C(2000000)
#define HASH_START UINT64_C(0xCBF29CE484222325) /* FNV-1a, a byte at a time */
#define HASH_PRIME UINT64_C(0x100000001B3)

static uint64_t hash;
static uint64_t events;

static void add(uint64_t value)
{
    for (unsigned i = 0; i < 64; i += 8)
        hash = (hash ^ (value >> i & 0xFFu)) * HASH_PRIME;
}

static void add_array(const uint64_t *values, size_t count)
{
    for (size_t i = 0; i < count; i++)
        add(values[i]);
}

#define ADD_ALL(...)                                                                               \
    add_array((const uint64_t[]){__VA_ARGS__}, sizeof((uint64_t[]){__VA_ARGS__}) / 8)

/* ---- Events ---------------------------------------------------------------------------------- */

/* Hashes an event of the bus that takes fast paths; the run calls this for each one. */
void diff_cover_event(diff_coverage *c, const cw_event *e, const cw_rule *rule)
{
    (void)c;
    (void)rule;
    events++;
    ADD_ALL(e->tick, e->nodes, e->kind, e->tec, e->rec, e->error.type, e->error.role,
            e->error.place.field, e->error.place.index, e->error.place.stuff,
            e->error.place.extended, e->error.flag, e->state, e->state_before, e->why, e->lost_bit,
            e->up, e->ticks, e->from, e->handed_in, e->rule, e->hit, e->frame.id, e->frame.flags,
            e->frame.dlc);
    for (unsigned i = 0; i < cw_frame_length(&e->frame); i++)
        add(e->frame.data[i]);
}

/* The differential test compares the two buses of a run; this program does not. */
bool diff_same_event(const cw_event *a, const cw_event *b)
{
    (void)a;
    (void)b;
    return true;
}

void diff_write_event(FILE *out, const cw_event *e)
{
    (void)out;
    (void)e;
}

/* ---- Statistics ------------------------------------------------------------------------------ */

static void add_delay(const cw_delay *d)
{
    ADD_ALL(d->count, d->sum_ticks, d->min_ticks, d->max_ticks, cw_delay_quantile_ticks(d, 500),
            cw_delay_quantile_ticks(d, 990));
    for (unsigned i = 0; i < CW_DELAY_BUCKETS; i++)
        add(d->bucket[i]);
}

static void add_counters(const cw_stat *counters, const void *stats)
{
    for (const cw_stat *s = counters; s->name; s++)
        for (unsigned i = 0; i < s->count; i++)
            add(cw_stat_value(s, stats, i));
}

static void add_node(const cw_node_stats *s)
{
    add_counters(cw_node_counters, s);
    ADD_ALL(s->tec, s->rec, s->state);
    add_delay(&s->delay);
}

static void add_bus(const cw_bus *bus, unsigned rules)
{
    cw_bus_stats s;
    cw_node_stats node;
    cw_rule_stats rule;
    cw_bus_get_stats(bus, &s);
    add_counters(cw_bus_counters, &s);
    ADD_ALL(cw_bus_now(bus), s.load_permille, cw_bus_pending(bus), cw_bus_recessive_bits(bus),
            cw_bus_idle(bus), cw_bus_next(bus));
    for (unsigned i = 0; cw_node_get_stats(bus, i, &node) == CW_OK; i++)
        add_node(&node);
    for (unsigned i = 0; i < rules; i++)
        if (cw_rule_get_stats(bus, i, &rule) == CW_OK)
            ADD_ALL(rule.matches, rule.hits, rule.active, rule.over);
}

/* Hashes the state of the buses; the run calls this from time to time, and at the end. */
bool diff_same_buses(const cw_bus *fast, const cw_bus *reference, unsigned rules, FILE *out)
{
    (void)out;
    add_bus(fast, rules);
    add_bus(reference, rules);
    return true;
}

/* The state of the last bit is part of that of the buses. */
bool diff_same_bits(const cw_bus *fast, const cw_bus *reference, FILE *out)
{
    (void)fast;
    (void)reference;
    (void)out;
    return true;
}

/* ---- Main ------------------------------------------------------------------------------------ */

int main(int argc, char **argv)
{
    static diff_scenario s;
    static diff_coverage c;
    diff_verdict verdict;
    uint64_t bits = argc > 1 ? strtoull(argv[1], NULL, 0) : BITS_DEFAULT;
    for (uint64_t seed = argc > 2 ? strtoull(argv[2], NULL, 0) : 1; c.bits < bits; seed++) {
        hash = HASH_START;
        events = 0;
        diff_generate(&s, seed);
        diff_run(&verdict, &s, &c, NULL);
        diff_scenario_free(&s);
        printf("seed %" PRIu64 ": %016" PRIx64 ", %" PRIu64 " events, %" PRIu64 " bits so far\n",
               seed, hash, events, c.bits);
        if (verdict.differs)
            return 1;
    }
    return 0;
}
