/* SPDX-License-Identifier: MIT
 *
 * pairs.c - what the nodes of a configuration leave each other: clocks, places, number (T10).
 */
#include "base/text/counted.h"
#include "config/parts.h"

#include "base/text/decimal.h"
#include "base/text/wide.h"
#include "config/values.h"

#include <inttypes.h>

#define PS_PER_TICK 12500u
#define TICK_BITS 32 /* of a cw_span below a tick */
#define QUANTA 16u   /* of a bit, where no key says anything: the library's default */
#define NODES_MAX 30u      /* ISO 11898 */
#define NODES_MAX_SLOW 20u /* ISO 11519-2 */
#define SLOW_BPS 125000u   /* ... which goes so far */
#define MM_PER_M 1000u
#define PPB_PER_MILLIPERCENT 10000u
#define PPM 1000000u
#define PPM_MAX 100000 /* of a clock in a configuration */
#define NODE_TEXT 40 /* most bytes of a node's name in a message */

/* ---- One node -------------------------------------------------------------------------------- */

/* Converts a span, in units of 2^-32 ticks, to picoseconds, rounded to the nearest. */
static uint64_t ps_of(cw_span span)
{
    const uint64_t whole = (uint64_t)span >> TICK_BITS;
    const uint64_t part = (uint64_t)span & UINT32_MAX;

    return whole * PS_PER_TICK + ((part * PS_PER_TICK + (UINT64_C(1) << (TICK_BITS - 1))) >>
                                  TICK_BITS);
}

static uint64_t slower_ps(const cw_span delays[2])
{
    return ps_of(delays[0] > delays[1] ? delays[0] : delays[1]);
}

/* Returns the bit timing that the library takes where no key says anything. The clock is 80 MHz, or
 * so many times faster that a bit has 16 quanta. */
static bit_timing timing_of_bus(const cfg *config)
{
    const uint32_t ticks = (uint32_t)cw_rate_ticks(config->rate, 1);
    uint32_t common = QUANTA;

    while (ticks % common > 0)
        common /= 2;
    return (bit_timing){.clock_hz = CW_CLOCK_HZ * (QUANTA / common), .brp = ticks / common,
                        .prop_seg = 6, .phase_seg1 = 7, .phase_seg2 = 2, .sjw = 1};
}

static uint32_t delay_tq(const bit_timing *bit, bool found)
{
    const uint32_t more = bit->phase_seg1 > bit->phase_seg2 ? bit->phase_seg1 - bit->phase_seg2 : 0;

    return found || bit->prop_seg == 0 ? bit->prop_seg + more : bit->prop_seg;
}

void cfg_timing_node(timing_node *out, const cfg *config, size_t node)
{
    const cfg_node_time *time = &config->nodes[node].time;
    const cw_node_timing *t = &time->timing;

    *out = (timing_node){
        .bit = time->used ? time->phase[0].bit : timing_of_bus(config),
        .ppm = time->ppm,
        .place_ps = ps_of(t->place),
        .stub_ps = ps_of(t->stub),
        .transfer_ps = slower_ps(t->tx_delay) + slower_ps(t->rx_delay),
    };
    out->delay_tq = delay_tq(&out->bit, time->phase[0].found || !time->used);
}

/* Returns a / b x scale, rounded to the nearest; b is more than 0, and a not much more than it. */
static int64_t ratio(cw_span a, cw_span b, uint64_t scale)
{
    uint64_t rest;
    const wide quotient = wide_divide(&rest, wide_product((uint64_t)a, scale), (uint64_t)b);

    return (int64_t)(quotient.low + (rest >= (uint64_t)b - rest));
}

void cfg_timing_now(bit_timing *bit, int64_t *ppm, const cfg *config, size_t node,
                    const cw_bit_timing *now)
{
    timing_node was;

    cfg_timing_node(&was, config, node);
    *bit = was.bit;
    bit->prop_seg = now->prop_seg;
    bit->phase_seg1 = now->phase_seg1;
    bit->phase_seg2 = now->phase_seg2;
    bit->sjw = now->sjw;
    *ppm = ratio(cw_quantum(bit->clock_hz, bit->brp, 0), now->quantum, PPM) - PPM;
    if (*ppm >= -PPM_MAX && *ppm <= PPM_MAX)
        return;
    const int64_t brp = ratio(now->quantum, cw_quantum(bit->clock_hz, 1, 0), 1);
    bit->brp = brp > 0 && brp <= UINT16_MAX ? (uint32_t)brp : 1;
    *ppm = ratio(cw_quantum(bit->clock_hz, bit->brp, 0), now->quantum, PPM) - PPM;
}

/* ---- Warnings -------------------------------------------------------------------------------- */

/* The pair that misses most of what is allowed, of all that miss any. */
typedef struct worst {
    int64_t left; /* less than 0 */
    size_t a;
    size_t b;
    timing_pair pair;
    size_t count; /* of all such pairs */
} worst;

/* Keeps the pair that misses most, and counts all that miss any. */
static void consider(worst *so_far, int64_t left, size_t a, size_t b, const timing_pair *pair)
{
    const size_t count = so_far->count + (left < 0);

    if (left < so_far->left)
        *so_far = (worst){left, a, b, *pair, 0};
    so_far->count = count;
}

/* Returns ", as do N other pairs", or nothing. */
static const char *others(schema *self, size_t count)
{
    if (count <= 1)
        return "";
    return schema_print(self, "; so it is with %s", counted(count - 1, "more pair").text);
}

/* Warns of the pair of nodes whose clocks differ most, and says how many others are no better. */
static void warn_of_clocks(schema *self, yaml_node_t *nodes, const worst *w)
{
    const cfg *config = cfg_of(self);
    const uint64_t is = 2 * (uint64_t)w->pair.need_ppb + PPB_PER_MILLIPERCENT - 1;
    const uint64_t allowed = 2 * (uint64_t)timing_limit_ppb(&w->pair);

    schema_warn(self, cfg_node_map(self, nodes, w->b),
                "'%.*s' and '%.*s' have no margin: their clocks differ by %s %%, %s %% are "
                "allowed%s",
                NODE_TEXT, config->nodes[w->a].name, NODE_TEXT, config->nodes[w->b].name,
                decimal(is / PPB_PER_MILLIPERCENT, 3).text,
                decimal(allowed / PPB_PER_MILLIPERCENT, 3).text, others(self, w->count));
}

/* Returns "; at most 12.5m ...", or that there is none. */
static const char *longest(schema *self, const worst *w)
{
    const cfg *config = cfg_of(self);
    const cw_node_timing *a = &config->nodes[w->a].time.timing;
    const cw_node_timing *b = &config->nodes[w->b].time.timing;
    const uint64_t stubs = ps_of(a->stub) + ps_of(b->stub);

    if (w->pair.longest_ps <= stubs || config->line_ps_per_m == 0)
        return "no line is short enough";
    return schema_print(self, "at most %s m are allowed",
                        decimal((w->pair.longest_ps - stubs) * MM_PER_M / config->line_ps_per_m,
                                3).text);
}

/* Warns of the pair of nodes for which the line is too long at this bit rate. */
static void warn_of_line(schema *self, yaml_node_t *nodes, const worst *w)
{
    const cfg *config = cfg_of(self);

    schema_warn(self, cfg_node_map(self, nodes, w->b),
                "the line between '%.*s' and '%.*s' is too long for %" PRIu32 " bit/s: the round "
                "trip takes %s ns, prop-seg %s ns; %s%s",
                NODE_TEXT, config->nodes[w->a].name, NODE_TEXT, config->nodes[w->b].name,
                config->bitrate_bps, decimal(w->pair.round_trip_ps, 3).text,
                decimal(w->pair.delays_ps, 3).text, longest(self, w), others(self, w->count));
}

/* Standards limit the nodes on a line by its speed; more of them are worth a warning alone. */
static void check_count(schema *self, yaml_node_t *nodes)
{
    const cfg *config = cfg_of(self);
    const bool slow = config->bitrate_bps > 0 && config->bitrate_bps <= SLOW_BPS;
    const size_t most = slow ? NODES_MAX_SLOW : NODES_MAX;

    if (config->node_count > most)
        schema_warn(self, nodes, "a line has at most %zu nodes by %s, not %zu", most,
                    slow ? "ISO 11519-2 (up to 125 kbit/s)" : "ISO 11898", config->node_count);
}

void cfg_check_pairs(schema *self, yaml_node_t *nodes)
{
    const cfg *config = cfg_of(self);
    timing_node all[CW_NODES_MAX];
    worst clock = {.left = 0}, line = {.left = 0};

    check_count(self, nodes);
    if (!config->nodes[0].time.used)
        return;
    for (size_t i = 0; i < config->node_count; i++)
        cfg_timing_node(&all[i], config, i);
    for (size_t b = 1; b < config->node_count; b++)
        for (size_t a = 0; a < b; a++) {
            const timing_pair pair = timing_pair_of(&all[a], &all[b]);
            const int64_t left = (int64_t)timing_limit_ppb(&pair) - pair.need_ppb;
            consider(&clock, left, a, b, &pair);
            consider(&line, timing_delays_left_ps(&pair), a, b, &pair);
        }
    if (clock.count > 0)
        warn_of_clocks(self, nodes, &clock);
    if (line.count > 0)
        warn_of_line(self, nodes, &line);
}
