/* SPDX-License-Identifier: MIT
 *
 * timing.c - the clocks of the nodes and the delays between them, by the configuration.
 */
#include "bus/bus_private.h"

/* The default: a bit in 16 quanta, which are a whole number of 2^-32 ticks in any case. */
static cw_bit_timing default_timing(cw_span bit_time)
{
    return (cw_bit_timing){.quantum = bit_time / 16,
                           .prop_seg = 6, .phase_seg1 = 7, .phase_seg2 = 2, .sjw = 1};
}

/* A delay is at most CW_DELAY_MAX, and never negative. */
static bool delay_valid(cw_span delay)
{
    return delay >= 0 && delay <= CW_DELAY_MAX;
}

static bool ways_valid(const cw_node_timing *t)
{
    return delay_valid(t->place) && delay_valid(t->stub) && delay_valid(t->tx_delay[0]) &&
           delay_valid(t->tx_delay[1]) && delay_valid(t->rx_delay[0]) &&
           delay_valid(t->rx_delay[1]) && delay_valid(t->ringing);
}

/* Returns the whole ticks that the bits of the bus have. */
static uint64_t ticks_of_bit(const cw_bus_config *c)
{
    const cw_rate rate = cw_rate_of(c->bit_ticks);
    return cw_rate_ticks(rate, 1);
}

/* Returns the bit time of a bus. Longer ones than the longest are not divided. */
static cw_span bit_time_of(const cw_bus_config *c)
{
    return CW_TICK * (cw_span)cw_least(ticks_of_bit(c), CW_DIVIDED_BIT_MAX);
}

/* Returns true when bits are short enough for moments within them to be counted. */
static bool divides_bits(const cw_bus_config *c)
{
    return ticks_of_bit(c) <= CW_DIVIDED_BIT_MAX;
}

/* Returns the length of a bit by a node's clock. */
static cw_span bit_length(const cw_bit_timing *t)
{
    return t->quantum * cw_bit_timing_quanta(t);
}

/* Returns true when all numbers of both are the same, not only the length of the bit. */
static bool same_timing(const cw_bit_timing *a, const cw_bit_timing *b)
{
    return a->quantum == b->quantum && a->prop_seg == b->prop_seg &&
           a->phase_seg1 == b->phase_seg1 && a->phase_seg2 == b->phase_seg2 && a->sjw == b->sjw &&
           a->triple_sampling == b->triple_sampling;
}

cw_bit_timing cw_bit_timing_of(const cw_bus_config *c, unsigned i)
{
    const cw_bit_timing *own = &c->nodes[i].timing.bit;
    return own->quantum ? *own : default_timing(bit_time_of(c));
}

/* Returns a node's way to the other nodes, as the cable knows it (T2). */
static cw_way way_of(const cw_node_timing *t)
{
    return (cw_way){.tx_delay = {t->tx_delay[0], t->tx_delay[1]},
                    .rx_delay = {t->rx_delay[0], t->rx_delay[1]},
                    .place = t->place, .stub = t->stub};
}

/* Returns the longest delay between nodes, or from one to itself. */
static cw_span longest_of(const cw_way *ways, unsigned count)
{
    cw_span longest = 0;
    for (unsigned from = 0; from < count; from++)
        for (unsigned to = 0; to < count; to++)
            for (unsigned level = 0; level < 2; level++) {
                const cw_span delay = cw_way_delay(&ways[from], &ways[to], level);
                longest = delay > longest ? delay : longest;
            }
    return longest;
}

/* Returns true when a node has no clock, no delay and no ringing of its own. */
static bool is_like_bus(const cw_node_timing *t)
{
    const cw_way way = way_of(t);
    return t->bit.quantum == 0 && t->ringing == 0 && cw_way_delay(&way, &way, CW_DOMINANT) == 0 &&
           cw_way_delay(&way, &way, CW_RECESSIVE) == 0 && way.place == 0 && way.stub == 0;
}

bool cw_is_lean(const cw_bus_config *c)
{
    bool lean = c->keeps_setup && !c->marks && !cw_has_data_rate(c);
    for (unsigned i = 0; i < c->node_count; i++)
        lean = lean && is_like_bus(&c->nodes[i].timing) && !c->nodes[i].sleeps;
    for (unsigned i = 0; i < c->rule_count; i++)
        lean = lean && cw_rule_keeps_setup(&c->rules[i]);
    return lean;
}

static void find_ways(cw_way ways[CW_NODES_MAX], const cw_bus_config *c)
{
    for (unsigned i = 0; i < c->node_count; i++)
        ways[i] = way_of(&c->nodes[i].timing);
}

cw_span cw_longest_ringing(const cw_bus_config *c)
{
    cw_span longest = 0;
    for (unsigned i = 0; i < c->node_count; i++)
        if (c->nodes[i].timing.ringing > longest)
            longest = c->nodes[i].timing.ringing;
    return longest;
}

cw_span cw_shortest_bit(const cw_bus_config *c)
{
    cw_span shortest = INT64_MAX;
    for (unsigned i = 0; i < c->node_count; i++) {
        const cw_bit_timing timing = cw_bit_timing_of(c, i);
        const cw_span bit = bit_length(&timing), data = cw_data_bit(c, i, &timing);
        shortest = bit < shortest ? bit : shortest;
        shortest = data < shortest ? data : shortest;
    }
    return shortest;
}

unsigned cw_bits_of_bit_time(const cw_bus_config *c)
{
    const cw_span bits = (bit_time_of(c) + cw_shortest_bit(c) - 1) / cw_shortest_bit(c);
    const cw_span more = cw_has_data_rate(c) ? bits / 4 + 1 : 0; /* clocks may become faster */
    return bits > 2 ? (unsigned)(bits + more) : 2;
}

/* Returns the bit timing of a node from its next bit on. */
static const cw_bit_timing *coming(const cw_timed *t, unsigned i)
{
    const cw_bit_timing *now = t->rates ? &t->rates[i].nominal : &t->nodes[i].timing;
    return t->nodes[i].retimed ? &t->next_timings[i] : now;
}

/* Returns true when bits are common to all nodes. */
static bool is_uniform(cw_bus *bus)
{
    const cw_timed *t = &bus->timed;
    bool uniform = t->longest == 0;
    for (unsigned i = 0; i < bus->node_count; i++)
        uniform = uniform && (bus->lean || t->ringing[i].now == 0) &&
                  same_timing(coming(t, 0), coming(t, i));
    return uniform && bit_length(coming(t, 0)) == t->bit_time &&
           (!t->rates || cw_rates_agree(bus, coming(t, 0)));
}

/* Returns true when a span has at most that many units. Spans of long bits are near the largest
 * number, so nothing is multiplied. */
static bool has_at_most(cw_span span, cw_span units, cw_span unit)
{
    return span / units + (span % units != 0) <= unit;
}

/* Returns a multiple of a span, or the longest one. */
static cw_span times(cw_span span, unsigned n)
{
    return span <= INT64_MAX / n ? span * n : INT64_MAX;
}

/* Looks at the values of a node by themselves. */
static cw_limit check_values(const cw_bus_config *c, unsigned i)
{
    const cw_node_timing *t = &c->nodes[i].timing;
    if (!cw_data_timing_valid(&t->data) || (t->bit.quantum != 0 && !cw_bit_timing_valid(&t->bit)))
        return CW_LIMIT_TIMING;
    if (t->bit.quantum != 0 && !divides_bits(c))
        return CW_LIMIT_LONG_BITS;
    return ways_valid(t) ? CW_LIMIT_NONE : CW_LIMIT_WAY;
}

/* Looks at the bits of a node, whose values are valid. */
static cw_bus_finding check_bits(const cw_bus_config *c, unsigned i)
{
    const cw_bit_timing timing = cw_bit_timing_of(c, i);
    const cw_span bit = bit_length(&timing), data = cw_data_bit(c, i, &timing);
    const cw_span least = bit_time_of(c) / CW_BIT_RATIO_MAX;
    cw_bus_finding found = {.node = (uint8_t)i, .is = bit};
    if (!has_at_most(bit, CW_BIT_RATIO_MAX, bit_time_of(c))) {
        found.limit = CW_LIMIT_BIT_MOST;
        found.allowed = times(bit_time_of(c), CW_BIT_RATIO_MAX);
    } else if (bit < least || data < least) {
        found.limit = CW_LIMIT_BIT_LEAST;
        found.allowed = least;
        found.fast = bit >= least;
        found.is = found.fast ? data : bit;
    }
    return found;
}

/* Looks at the ways between nodes, whose values are valid. */
static cw_bus_finding check_ways(const cw_bus_config *c)
{
    cw_way ways[CW_NODES_MAX];
    const cw_span shortest = cw_shortest_bit(c);
    find_ways(ways, c);
    for (unsigned from = 0; from < c->node_count; from++)
        for (unsigned to = 0; to < c->node_count; to++) {
            const cw_span one = cw_way_delay(&ways[from], &ways[to], 0);
            const cw_span other = cw_way_delay(&ways[from], &ways[to], 1);
            const cw_span delay = one > other ? one : other;
            cw_bus_finding found = {.node = (uint8_t)from, .other = (uint8_t)to, .is = delay,
                                    .allowed = times(shortest, CW_DELAY_BITS_MAX)};
            if (delay > 0 && !divides_bits(c))
                found.limit = CW_LIMIT_LONG_BITS;
            else if (!has_at_most(delay, CW_DELAY_BITS_MAX, shortest))
                found.limit = CW_LIMIT_DELAY;
            if (found.limit != CW_LIMIT_NONE)
                return found;
        }
    return (cw_bus_finding){.limit = CW_LIMIT_NONE};
}

cw_bus_finding cw_check_timing(const cw_bus_config *c)
{
    for (unsigned i = 0; i < c->node_count; i++) {
        const cw_limit limit = check_values(c, i);
        if (limit != CW_LIMIT_NONE)
            return (cw_bus_finding){.limit = limit, .node = (uint8_t)i};
    }
    for (unsigned i = 0; i < c->node_count; i++) {
        const cw_bus_finding found = check_bits(c, i);
        if (found.limit != CW_LIMIT_NONE)
            return found;
    }
    return check_ways(c);
}

/* Returns the shortest bit of any node, in thousandths of a bit of the bus. */
static uint32_t fastest_permille(const cw_bus_config *c)
{
    const cw_span permille = cw_shortest_bit(c) / (bit_time_of(c) / 1000);
    return permille < 999 ? (uint32_t)permille : 999;
}

/* Finds out whether bits are common to all nodes. Longer ones than the longest are. */
static void find_uniform(cw_bus *bus)
{
    bus->timed.uniform = is_uniform(bus) || !bus->timed.divides;
    cw_outlook_forget(bus);
}

/* Sets up delays and ringing. */
static void init_ways(cw_timed *t, const cw_bus_config *c)
{
    find_ways(cw_cable_ways(&t->cable), c);
    t->longest = cw_cable_find_delays(&t->cable);
    for (unsigned i = 0; i < c->node_count; i++)
        t->ringing[i] = (cw_ringing){.now = c->nodes[i].timing.ringing};
    cw_timed_begin_ringing(t);
}

void cw_init_timing(cw_bus *bus, const cw_bus_config *c)
{
    cw_timed *t = &bus->timed;
    for (unsigned i = 0; i < c->node_count; i++) {
        const cw_bit_timing timing = cw_bit_timing_of(c, i);
        cw_timed_set_timing(&t->nodes[i], &timing);
        if (t->rates)
            cw_init_rates(bus, i, &c->nodes[i].timing.data, &timing);
    }
    if (!bus->lean)
        init_ways(t, c);
    t->bit_time = bit_time_of(c);
    t->divides = divides_bits(c);
    t->bits_of_bit_time = cw_bits_of_bit_time(c);
    t->fastest_permille = fastest_permille(c);
    find_uniform(bus);
    cw_find_longest(bus);
}

void cw_find_longest(cw_bus *bus)
{
    const cw_span longest = bus->timed.longest + bus->rules.jitter;
    if (longest > bus->timed.cable.longest) /* edges may still be under way */
        bus->timed.cable.longest = longest;
}

/* ---- Changes --------------------------------------------------------------------------------- */

/* The limits are those of check_bits() and check_ways(). The room for events is enough for that
 * many bits of a node in one of the bus. */
static bool change_fits(const cw_bit_timing *timing, cw_span bit_time, unsigned bits,
                        cw_span longest)
{
    return cw_bit_timing_valid(timing) &&
           has_at_most(bit_length(timing), CW_BIT_RATIO_MAX, bit_time) &&
           bit_length(timing) >= bit_time / CW_BIT_RATIO_MAX &&
           has_at_most(bit_time, bits, bit_length(timing)) &&
           has_at_most(longest, CW_DELAY_BITS_MAX, bit_length(timing));
}

bool cw_new_timing_valid(const cw_bus *bus, unsigned i, const cw_bit_timing *timing,
                         const cw_data_timing *data)
{
    const cw_timed *t = &bus->timed;
    if (bus->lean || (data && (!t->rates || !cw_data_timing_valid(data))))
        return false;
    const cw_bit_timing fast = t->rates ? cw_new_data_bit(bus, i, timing, data) : *timing;
    return t->divides && change_fits(&fast, t->bit_time, t->bits_of_bit_time, t->longest) &&
           change_fits(timing, t->bit_time, t->bits_of_bit_time, t->longest);
}

cw_bit_timing cw_timing_with(const cw_bit_timing *now, const cw_settings *s)
{
    cw_bit_timing next = s->which & CW_SET_SEGMENTS ? s->timing : *now;
    next.quantum = s->which & CW_SET_QUANTUM ? s->timing.quantum : now->quantum;
    next.triple_sampling =
        s->which & CW_SET_SAMPLING ? s->timing.triple_sampling : now->triple_sampling;
    return next;
}

/* Replaces both delays, if they change. */
static void change_delay(cw_span delay[2], const cw_span to[2], bool changes)
{
    for (unsigned level = 0; changes && level < 2; level++)
        delay[level] = to[level];
}

/* Returns a way with the changes that settings bring. */
static cw_way way_with(const cw_way *now, const cw_settings *s)
{
    cw_way way = *now;
    change_delay(way.tx_delay, s->tx_delay, s->which & CW_SET_TX_DELAY);
    change_delay(way.rx_delay, s->rx_delay, s->which & CW_SET_RX_DELAY);
    way.place = s->which & CW_SET_PLACE ? s->place : way.place;
    way.stub = s->which & CW_SET_STUB ? s->stub : way.stub;
    return way;
}

/* Returns true when a node can get another way, and its wire another ringing. */
static bool way_fits(const cw_way *ways, unsigned count, unsigned node, const cw_settings *s,
                     cw_span shortest)
{
    cw_way next[CW_NODES_MAX];
    for (unsigned i = 0; i < count; i++)
        next[i] = ways[i];
    next[node] = way_with(&next[node], s);
    const cw_way *way = &next[node];
    const cw_span ringing = s->which & CW_SET_RINGING ? s->ringing : 0;
    const bool valid = delay_valid(way->place) && delay_valid(way->stub) &&
                       delay_valid(way->tx_delay[0]) && delay_valid(way->tx_delay[1]) &&
                       delay_valid(way->rx_delay[0]) && delay_valid(way->rx_delay[1]) &&
                       delay_valid(ringing);
    return valid && has_at_most(longest_of(next, count), CW_DELAY_BITS_MAX, shortest) &&
           has_at_most(ringing, CW_DELAY_BITS_MAX, shortest);
}

bool cw_bus_config_takes(const cw_bus_config *c, unsigned node, const cw_settings *s)
{
    const cw_bit_timing now = cw_bit_timing_of(c, node);
    const cw_bit_timing next = cw_timing_with(&now, s);
    const bool changes_data = s->which & CW_SET_DATA;
    const cw_data_timing *data = changes_data ? &s->data : &c->nodes[node].timing.data;
    cw_way ways[CW_NODES_MAX];
    find_ways(ways, c);
    if (!cw_data_timing_valid(data) || (changes_data && !cw_has_data_rate(c)))
        return false;
    const cw_bit_timing fast = cw_data_bit_timing(data, &next);
    return divides_bits(c) && way_fits(ways, c->node_count, node, s, cw_shortest_bit(c)) &&
           change_fits(&next, bit_time_of(c), cw_bits_of_bit_time(c),
                       longest_of(ways, c->node_count)) &&
           change_fits(&fast, bit_time_of(c), cw_bits_of_bit_time(c),
                       longest_of(ways, c->node_count));
}

/* ---- Ways and ringing ------------------------------------------------------------------------ */

/* Returns the longest ringing that may be on the wire, those from before a change included. */
static cw_span longest_former_ringing(const cw_timed *t)
{
    cw_span longest = 0;
    for (unsigned i = 0; i < t->cable.node_count; i++) {
        const cw_span one = cw_timed_longest_ringing(t, i);
        longest = one > longest ? one : longest;
    }
    return longest;
}

/* Returns the shortest bit of a node, from its next one on, and the longest one. */
static cw_span shortest_coming(const cw_timed *t, cw_span *longest)
{
    cw_span shortest = INT64_MAX;
    *longest = 0;
    for (unsigned i = 0; i < t->cable.node_count; i++) {
        const cw_span bit = bit_length(coming(t, i));
        shortest = bit < shortest ? bit : shortest;
        *longest = bit > *longest ? bit : *longest;
    }
    return shortest;
}

/* Returns true when a disturbance under way has the present delays, so that they must be kept. */
static bool carries_others(const cw_timed *t)
{
    return cw_disturbs_by(&t->disturbances, t->cable.ways);
}

/* Nodes look back by their present bit, and by what rings. */
bool cw_new_way_valid(const cw_bus *bus, unsigned i, const cw_settings *s)
{
    const cw_timed *t = &bus->timed;
    cw_span longest;
    if (bus->lean)
        return false;
    const cw_span shortest = shortest_coming(t, &longest);
    const cw_span back = 2 * longest + longest_former_ringing(t);
    return t->divides &&
           way_fits(cw_cable_ways(&t->cable), t->cable.node_count, i, s, shortest) &&
           (!t->active || !(s->which & CW_SET_WAY) ||
            cw_cable_takes_way(&t->cable, carries_others(t), t->moment, back));
}

void cw_set_way(cw_bus *bus, unsigned i, const cw_settings *s)
{
    cw_timed *t = &bus->timed;
    for (unsigned k = 0; k < bus->node_count; k++)
        cw_timed_settle(t, k);
    if (s->which & CW_SET_WAY) {
        const cw_way way = way_with(&cw_cable_ways(&t->cable)[i], s);
        cw_cable_set_way(&t->cable, i, &way, carries_others(t), t->moment);
        t->longest = cw_cable_find_delays(&t->cable);
        t->disturbances.ways = t->cable.ways;
        cw_find_longest(bus);
    }
    if (s->which & CW_SET_RINGING) {
        cw_timed_catch_up(bus);
        cw_timed_set_ringing(t, i, s->ringing);
    }
    t->clean.valid = false;
    find_uniform(bus);
}

void cw_get_way(const cw_bus *bus, unsigned i, cw_settings *s)
{
    s->which |= CW_SET_WAY | CW_SET_RINGING;
    if (bus->lean)
        return;
    const cw_way *way = &cw_cable_ways(&bus->timed.cable)[i];
    change_delay(s->tx_delay, way->tx_delay, true);
    change_delay(s->rx_delay, way->rx_delay, true);
    s->place = way->place;
    s->stub = way->stub;
    s->ringing = bus->timed.ringing[i].now;
}

/* ---- Bit timings ----------------------------------------------------------------------------- */

void cw_retime(cw_bus *bus, unsigned i, const cw_bit_timing *timing, const cw_data_timing *data)
{
    cw_timed_node *n = &bus->timed.nodes[i];
    cw_timed_settle(&bus->timed, i);
    bus->timed.clean.valid = false;
    if (bus->timed.rates)
        cw_note_next_data(bus, i, data);
    bus->timed.next_timings[i] = *timing;
    n->retimed = bus->timed.active;
    if (!bus->timed.active && bus->timed.rates)
        cw_timed_retime_rates(bus, i);
    else if (!bus->timed.active)
        cw_timed_set_timing(n, timing);
    if (!bus->timed.active && bus->tt)
        cw_tt_retime(bus, i, (cw_instant){.tick = cw_now(bus)});
    const uint32_t permille = (uint32_t)(bit_length(timing) / (bus->timed.bit_time / 1000));
    if (permille < bus->timed.fastest_permille)
        bus->timed.fastest_permille = permille;
    find_uniform(bus);
}

cw_bit_timing cw_timing_now(const cw_bus *bus, unsigned i)
{
    return *coming(&bus->timed, i);
}

/* The quantum of a rule may be too far from that of a node. Then it goes as far as it may. */
void cw_retime_quantum(cw_bus *bus, uint64_t nodes, cw_span quantum)
{
    for (uint64_t rest = nodes & bus->all; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        cw_bit_timing timing = cw_timing_now(bus, i);
        if (timing.quantum == quantum)
            continue;
        timing.quantum = quantum;
        if (cw_new_timing_valid(bus, i, &timing, NULL))
            cw_retime(bus, i, &timing, NULL);
    }
}
