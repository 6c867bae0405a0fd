/* SPDX-License-Identifier: MIT
 *
 * retime.c - keys of a node's bit timing and of its place as texts. They change a node that is in
 * use.
 */
#include "config/retime.h"

#include "base/schema.h"
#include "config/phases.h"

#include <inttypes.h>
#include <stdarg.h>
#include <string.h>

#define CLOCK_MIN_HZ 100000u
#define CLOCK_MAX_HZ 1000000000u
#define PPM_MAX 100000u

#define BIT(key) (1u << (key))
#define SEGMENTS                                                                                   \
    (BIT(RETIME_BRP) | BIT(RETIME_PROP_SEG) | BIT(RETIME_PHASE_SEG1) | BIT(RETIME_PHASE_SEG2))
#define DATA_MASK (BIT(RETIME_TDCV + 1) - BIT(RETIME_DBRP))

/* A key whose value is a number of quanta or clocks. */
typedef struct number {
    uint32_t min;
    uint32_t max;
    size_t offset; /* in a cfg_retime */
} number;

static const char *const names[RETIME_KEYS] = {
    [RETIME_CLOCK] = "clock",
    [RETIME_PPM] = "ppm",
    [RETIME_SAMPLE_POINT] = "sample-point",
    [RETIME_BRP] = "brp",
    [RETIME_PROP_SEG] = "prop-seg",
    [RETIME_PHASE_SEG1] = "phase-seg1",
    [RETIME_PHASE_SEG2] = "phase-seg2",
    [RETIME_SJW] = "sjw",
    [RETIME_TRIPLE_SAMPLING] = "triple-sampling",
    [RETIME_DBRP] = "dbrp",
    [RETIME_DPROP_SEG] = "dprop-seg",
    [RETIME_DPHASE_SEG1] = "dphase-seg1",
    [RETIME_DPHASE_SEG2] = "dphase-seg2",
    [RETIME_DSJW] = "dsjw",
    [RETIME_DSAMPLE_POINT] = "dsample-point",
    [RETIME_TDC_MODE] = "tdc-mode",
    [RETIME_TDCO] = "tdco",
    [RETIME_TDCV] = "tdcv",
    [RETIME_TX_DELAY] = "tx-delay",
    [RETIME_RX_DELAY] = "rx-delay",
    [RETIME_POSITION] = "position",
    [RETIME_STUB] = "stub",
    [RETIME_RINGING] = "ringing",
};

/* The settings of keys of the place. */
static const unsigned ways[RETIME_KEYS] = {
    [RETIME_TX_DELAY] = CW_SET_TX_DELAY, [RETIME_RX_DELAY] = CW_SET_RX_DELAY,
    [RETIME_POSITION] = CW_SET_PLACE,    [RETIME_STUB] = CW_SET_STUB,
    [RETIME_RINGING] = CW_SET_RINGING,
};

static const number numbers[RETIME_KEYS] = {
    [RETIME_BRP] = {1, CFG_BRP_MAX, offsetof(cfg_retime, bit.brp)},
    [RETIME_PROP_SEG] = {0, CFG_SEGMENT_MAX, offsetof(cfg_retime, bit.prop_seg)},
    [RETIME_PHASE_SEG1] = {1, CFG_SEGMENT_MAX, offsetof(cfg_retime, bit.phase_seg1)},
    [RETIME_PHASE_SEG2] = {1, CFG_SEGMENT_MAX, offsetof(cfg_retime, bit.phase_seg2)},
    [RETIME_SJW] = {1, CFG_SJW_MAX, offsetof(cfg_retime, bit.sjw)},
    [RETIME_DBRP] = {1, CFG_BRP_MAX, offsetof(cfg_retime, data.bit.brp)},
    [RETIME_DPROP_SEG] = {0, CFG_SEGMENT_MAX, offsetof(cfg_retime, data.bit.prop_seg)},
    [RETIME_DPHASE_SEG1] = {1, CFG_SEGMENT_MAX, offsetof(cfg_retime, data.bit.phase_seg1)},
    [RETIME_DPHASE_SEG2] = {1, CFG_SEGMENT_MAX, offsetof(cfg_retime, data.bit.phase_seg2)},
    [RETIME_DSJW] = {1, CFG_SJW_MAX, offsetof(cfg_retime, data.bit.sjw)},
    [RETIME_TDCO] = {0, CFG_TDC_CLOCKS_MAX, offsetof(cfg_retime, data.tdco)},
    [RETIME_TDCV] = {1, CFG_TDC_CLOCKS_MAX, offsetof(cfg_retime, data.tdcv)},
};

const char *cfg_retime_name(retime_key key)
{
    return names[key];
}

retime_key cfg_retime_find(const char *name)
{
    retime_key key = 0;
    while (key < RETIME_KEYS && strcmp(names[key], name) != 0)
        key++;
    return key;
}

/* Returns false, for the caller to return. */
static bool __attribute__((format(printf, 2, 3)))
refuse(char problem[RETIME_PROBLEM_MAX], const char *format, ...)
{
    va_list args;
    va_start(args, format);
    (void)vsnprintf(problem, RETIME_PROBLEM_MAX, format, args);
    va_end(args);
    return false;
}

/* ---- Values ---------------------------------------------------------------------------------- */

bool cfg_clock_valid(uint64_t hz)
{
    return hz >= CLOCK_MIN_HZ && hz <= CLOCK_MAX_HZ;
}

bool cfg_parse_ppm(int32_t *ppm, const char *text)
{
    const bool negative = *text == '-';
    uint64_t size;
    if (text_parse_uint(&size, text + negative) || size > PPM_MAX)
        return false;
    *ppm = negative ? -(int32_t)size : (int32_t)size;
    return true;
}

static bool put_clock(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], const char *text)
{
    uint64_t hz;
    const char *wrong = text_parse_frequency(&hz, text);
    if (wrong)
        return refuse(problem, "clock: '%.40s': %s", text, wrong);
    if (!cfg_clock_valid(hz))
        return refuse(problem, "clock: expected " CFG_CLOCK_RANGE ", not '%.40s'", text);
    change->bit.clock_hz = (uint32_t)hz;
    return true;
}

static bool put_ppm(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], const char *text)
{
    return cfg_parse_ppm(&change->ppm, text) ||
           refuse(problem, "ppm: expected " CFG_PPM_RANGE ", not '%.40s'", text);
}

static bool put_sample_point(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], retime_key key,
                             const char *text)
{
    const char *wrong = text_parse_sample_point(key == RETIME_SAMPLE_POINT
                                                    ? &change->sample_permille
                                                    : &change->data.sample_permille,
                                                text);
    return !wrong || refuse(problem, "%s: '%.40s': %s", names[key], text, wrong);
}

static bool put_tdc_mode(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], const char *text)
{
    return cfg_parse_tdc(&change->data.tdc, text) ||
           refuse(problem, "tdc-mode: expected one of off, auto, manual, not '%.40s'", text);
}

static bool put_number(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], retime_key key,
                       const char *text)
{
    const number *n = &numbers[key];
    uint64_t value;
    if (text_parse_uint(&value, text) || value < n->min || value > n->max)
        return refuse(problem, "%s: expected a decimal integer %" PRIu32 "..%" PRIu32
                      ", not '%.40s'", names[key], n->min, n->max, text);
    *(uint32_t *)(void *)((char *)change + n->offset) = (uint32_t)value;
    return true;
}

static bool put_triple(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], const char *text)
{
    return schema_parse_bool(&change->triple_sampling, text) ||
           refuse(problem, "triple-sampling: expected one of on, off, yes, no, true, false, not "
                  "'%.40s'", text);
}

static bool put_way(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], retime_key key,
                    const char *text)
{
    cfg_way *way = &change->way;
    const bool length = key == RETIME_POSITION || key == RETIME_STUB;
    bool right;
    if (length)
        right = cfg_parse_way(key == RETIME_STUB ? &way->stub_mm : &way->position_mm, text);
    else if (key == RETIME_RINGING)
        right = cfg_parse_delay(&way->ringing, text);
    else
        right = cfg_parse_delays(key == RETIME_TX_DELAY ? way->tx_delay : way->rx_delay, text);
    const char *range = length ? CFG_LENGTH_RANGE
                               : key == RETIME_RINGING ? CFG_DELAY_RANGE : CFG_DELAYS_RANGE;
    return right ||
           refuse(problem, "%s: expected %s, not '%.40s'", names[key], range, text);
}

static bool put_value(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], retime_key key,
                      const char *text)
{
    switch (key) {
    case RETIME_CLOCK:
        return put_clock(change, problem, text);
    case RETIME_PPM:
        return put_ppm(change, problem, text);
    case RETIME_SAMPLE_POINT:
    case RETIME_DSAMPLE_POINT:
        return put_sample_point(change, problem, key, text);
    case RETIME_TDC_MODE:
        return put_tdc_mode(change, problem, text);
    case RETIME_TRIPLE_SAMPLING:
        return put_triple(change, problem, text);
    case RETIME_BRP:
    case RETIME_PROP_SEG:
    case RETIME_PHASE_SEG1:
    case RETIME_PHASE_SEG2:
    case RETIME_SJW:
    case RETIME_DBRP:
    case RETIME_DPROP_SEG:
    case RETIME_DPHASE_SEG1:
    case RETIME_DPHASE_SEG2:
    case RETIME_DSJW:
    case RETIME_TDCO:
    case RETIME_TDCV:
        return put_number(change, problem, key, text);
    case RETIME_TX_DELAY:
    case RETIME_RX_DELAY:
    case RETIME_POSITION:
    case RETIME_STUB:
    case RETIME_RINGING:
        return put_way(change, problem, key, text);
    case RETIME_KEYS:
        break;
    }
    return refuse(problem, "there is no such key");
}

bool cfg_retime_put(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], retime_key key,
                    const char *text)
{
    if (!put_value(change, problem, key, text))
        return false;
    change->given |= BIT(key);
    return true;
}

static const char *print_one(char text[TIME_TEXT_MAX], const cfg_retime *values, retime_key key)
{
    uint32_t value = values->bit.clock_hz;
    if (key == RETIME_TRIPLE_SAMPLING)
        return values->triple_sampling ? "on" : "off";
    if (key == RETIME_TDC_MODE)
        return cfg_tdc_name(values->data.tdc);
    if (numbers[key].max > 0)
        memcpy(&value, (const char *)values + numbers[key].offset, sizeof value);
    if (key == RETIME_PPM)
        (void)snprintf(text, TIME_TEXT_MAX, "%" PRId32, values->ppm);
    else if (key == RETIME_SAMPLE_POINT)
        (void)snprintf(text, TIME_TEXT_MAX, "0.%03u", (unsigned)values->sample_permille);
    else if (key == RETIME_DSAMPLE_POINT)
        (void)snprintf(text, TIME_TEXT_MAX, "0.%03u", (unsigned)values->data.sample_permille);
    else
        (void)snprintf(text, TIME_TEXT_MAX, "%" PRIu32, value);
    return text;
}

static void print_way(char text[TIME_TEXT_MAX], const cfg_way *way, retime_key key)
{
    const uint64_t mm = key == RETIME_STUB ? way->stub_mm : way->position_mm;
    if (key == RETIME_RINGING)
        cfg_print_delay(text, &way->ringing);
    else if (key == RETIME_POSITION || key == RETIME_STUB)
        (void)snprintf(text, TIME_TEXT_MAX, "%" PRIu64 "mm", mm);
    else
        cfg_print_delays(text, key == RETIME_TX_DELAY ? way->tx_delay : way->rx_delay);
}

void cfg_retime_print(char text[TIME_TEXT_MAX], const cfg_retime *values, retime_key key)
{
    if (ways[key]) {
        print_way(text, &values->way, key);
        return;
    }
    const char *printed = print_one(text, values, key);
    if (printed != text)
        (void)snprintf(text, TIME_TEXT_MAX, "%s", printed);
}

/* ---- A change -------------------------------------------------------------------------------- */

/* Returns the keys of a node in use. Without any it has the default of the library, whose clock is
 * not known. */
static cfg_node_time present(const cfg *config, unsigned node)
{
    cfg_node_time time = config->nodes[node].time;
    if (time.bit.phase_seg2 == 0)
        time.bit = (bit_timing){.brp = 1, .prop_seg = 6, .phase_seg1 = 7, .phase_seg2 = 2,
                                .sjw = 1};
    if (!time.limits)
        time.limits = timing_controller("any");
    return time;
}

/* Returns the keys of the place that are not 0. */
static unsigned present_way(const cw_node_timing *t, const cfg_node_time *time)
{
    return (t->tx_delay[0] || t->tx_delay[1] ? BIT(RETIME_TX_DELAY) : 0) |
           (t->rx_delay[0] || t->rx_delay[1] ? BIT(RETIME_RX_DELAY) : 0) |
           (time->position_mm ? BIT(RETIME_POSITION) : 0) |
           (time->stub_mm ? BIT(RETIME_STUB) : 0) | (t->ringing ? BIT(RETIME_RINGING) : 0);
}

/* Returns the keys of the data phase that mean anything. */
static unsigned present_data(const cfg_redata *data)
{
    unsigned given = DATA_MASK & ~BIT(RETIME_DSAMPLE_POINT);
    if (data->bit.clock_hz == 0)
        return 0;
    if (data->tdc == CFG_TDC_OFF)
        given &= ~BIT(RETIME_TDCO);
    if (data->tdc != CFG_TDC_MANUAL)
        given &= ~BIT(RETIME_TDCV);
    return given;
}

static cfg_way way_of(const cfg_node_time *time)
{
    const cw_node_timing *t = &time->timing;
    return (cfg_way){.tx_delay = {cfg_delay_of(t->tx_delay[0]), cfg_delay_of(t->tx_delay[1])},
                     .rx_delay = {cfg_delay_of(t->rx_delay[0]), cfg_delay_of(t->rx_delay[1])},
                     .position_mm = time->position_mm,
                     .stub_mm = time->stub_mm,
                     .ringing = cfg_delay_of(t->ringing)};
}

cfg_retime cfg_retime_present(const cfg_node_time *time)
{
    const cfg_redata data = cfg_data_present(time);
    const unsigned known = time->bit.clock_hz ? SEGMENTS | BIT(RETIME_SJW) | BIT(RETIME_CLOCK) : 0;
    const unsigned always = BIT(RETIME_PPM) | BIT(RETIME_TRIPLE_SAMPLING);
    const unsigned way = present_way(&time->timing, time);
    return (cfg_retime){.given = known | always | way | present_data(&data),
                        .way = way_of(time),
                        .data = data,
                        .bit = time->bit,
                        .ppm = time->ppm,
                        .triple_sampling = time->triple_sampling};
}

static void take_numbers(bit_timing *bit, const cfg_retime *change)
{
    for (retime_key key = RETIME_BRP; key <= RETIME_SJW; key++)
        if (change->given & BIT(key))
            memcpy((char *)bit + (numbers[key].offset - offsetof(cfg_retime, bit)),
                   (const char *)change + numbers[key].offset, sizeof(uint32_t));
}

/* Returns the first key of the segments that is missing. */
static const char *first_missing(unsigned given)
{
    retime_key key = RETIME_BRP;
    while (given & BIT(key))
        key++;
    return names[key];
}

static bool keys_agree(char problem[RETIME_PROBLEM_MAX], unsigned given, bool clock_known)
{
    const unsigned segments = given & SEGMENTS;
    if (segments && (given & BIT(RETIME_SAMPLE_POINT)))
        return refuse(problem,
                      "sample-point: the segments say where it is; use one or the other");
    if (!clock_known && segments && segments != SEGMENTS)
        return refuse(problem, "%s is missing: brp, prop-seg, phase-seg1 and phase-seg2 are "
                      "needed together, as the configuration has none of them",
                      first_missing(segments));
    return true;
}

/* Changes the bit. A node without segments of its own finds them with its clock. */
static bool change_bit(cfg_node_time *time, char problem[RETIME_PROBLEM_MAX], const cfg *config,
                       const cfg_retime *change, unsigned *which)
{
    const unsigned given = change->given;
    const bool clock_known = time->bit.clock_hz > 0;
    const bool finds = (given & BIT(RETIME_SAMPLE_POINT)) ||
                       (!clock_known && (given & BIT(RETIME_CLOCK)) && !(given & SEGMENTS));
    char wrong[TIMING_PROBLEM_MAX];
    if (given & BIT(RETIME_CLOCK))
        time->bit.clock_hz = change->bit.clock_hz;
    else if (!clock_known && (finds || (given & SEGMENTS)))
        time->bit.clock_hz = CFG_CLOCK_DEFAULT_HZ;
    if (finds || (!clock_known && (given & SEGMENTS)))
        time->bit.sjw = 0;
    if (given & SEGMENTS)
        time->found = false;
    take_numbers(&time->bit, change);
    if (given & BIT(RETIME_SAMPLE_POINT))
        time->sample_permille = change->sample_permille;
    if (finds ? !cfg_find_segments(time, wrong, config) : !cfg_fit_segments(time, wrong))
        return refuse(problem, "%s", wrong);
    if (finds || (given & (BIT(RETIME_BRP) | BIT(RETIME_CLOCK) | BIT(RETIME_PPM))))
        *which |= CW_SET_QUANTUM;
    if (finds || (given & (SEGMENTS & ~BIT(RETIME_BRP))) || (given & BIT(RETIME_SJW)))
        *which |= CW_SET_SEGMENTS;
    return true;
}

static bool refuse_data(char problem[RETIME_PROBLEM_MAX], const cfg *config, unsigned node,
                     unsigned given)
{
    retime_key key = RETIME_DBRP;
    while (!(given & BIT(key)))
        key++;
    return refuse(problem, "%s: %s", names[key],
                  cfg_knows_fd(config, &config->nodes[node])
                      ? "the bus has no data rate; bus: { dbitrate } gives it one"
                      : "only a node of kind fd has a data phase");
}

/* Changes the data phase. Whenever a quantum is given, that of the other phase is, too: what rules
 * have done to it ends. */
static bool change_data(cfg_node_time *time, char problem[RETIME_PROBLEM_MAX], const cfg *config,
                        unsigned node, const cfg_retime *change, unsigned *which)
{
    const unsigned given = change->given & DATA_MASK;
    const bool found_anew = change->given & BIT(RETIME_SAMPLE_POINT);
    bool bit_changes;
    if (time->data.clock_hz == 0)
        return !given || refuse_data(problem, config, node, given);
    if (!given && !(*which & CW_SET_QUANTUM))
        return true;
    if (!cfg_change_data(time, problem, RETIME_PROBLEM_MAX, &bit_changes, config, &change->data,
                         given >> RETIME_DBRP, found_anew))
        return false;
    *which |= CW_SET_QUANTUM | CW_SET_DATA | (bit_changes ? CW_SET_SEGMENTS : 0);
    return true;
}

cw_bit_timing cfg_bit_timing(const cfg_node_time *time, cw_span nominal)
{
    const bit_timing *bit = &time->bit;
    return (cw_bit_timing){
        .quantum = bit->clock_hz ? cw_quantum(bit->clock_hz, bit->brp, time->ppm)
                                 : cfg_drifted(nominal, time->ppm),
        .prop_seg = (uint16_t)bit->prop_seg,
        .phase_seg1 = (uint16_t)bit->phase_seg1,
        .phase_seg2 = (uint16_t)bit->phase_seg2,
        .sjw = (uint16_t)bit->sjw,
        .triple_sampling = time->triple_sampling,
    };
}

cw_span cfg_nominal_quantum(const cfg *config, unsigned node)
{
    const bit_timing *bit = &config->nodes[node].time.bit;

    /* without keys the default of the library: a bit in 16 quanta */
    return bit->clock_hz ? cw_quantum(bit->clock_hz, bit->brp, 0)
                         : (cw_span)cw_rate_ticks(config->rate, 1) * (CW_TICK / 16);
}

static bool bus_takes(const cfg *config, unsigned node, const cw_settings *settings)
{
    cw_node_config nodes[CW_NODES_MAX];
    cw_bus_config bus;
    cfg_bus_config(&bus, nodes, config);
    return cw_bus_config_takes(&bus, node, settings);
}

/* Returns the keys of the place that are given, as CW_SET_*. */
static unsigned ways_given(const cfg_retime *change)
{
    unsigned given = 0;
    for (retime_key key = 0; key < RETIME_KEYS; key++)
        given |= change->given & BIT(key) ? ways[key] : 0;
    return given;
}

bool cfg_retime_node(cfg_node_time *out, cw_settings *set, char problem[RETIME_PROBLEM_MAX],
                     const cfg *config, unsigned node, const cfg_retime *change)
{
    cfg_node_time time = present(config, node);
    unsigned which = 0;
    if (change->given & BIT(RETIME_PPM))
        time.ppm = change->ppm;
    if (change->given & BIT(RETIME_TRIPLE_SAMPLING)) {
        time.triple_sampling = change->triple_sampling;
        which |= CW_SET_SAMPLING;
    }
    if (!keys_agree(problem, change->given, time.bit.clock_hz > 0) ||
        !change_bit(&time, problem, config, change, &which) ||
        !change_data(&time, problem, config, node, change, &which))
        return false;
    set->which = (uint16_t)((set->which & ~(CW_SET_TIMING | CW_SET_UNIT)) | which);
    set->timing = cfg_bit_timing(&time, cfg_nominal_quantum(config, node));
    set->data = cfg_data_timing(&time);
    if ((which & CW_SET_QUANTUM) && config->nodes[node].local.bits) {
        set->which |= CW_SET_UNIT;
        set->unit = cfg_local_unit(&config->nodes[node], time.ppm);
    }
    if (!bus_takes(config, node, set))
        return refuse(problem, "a bit of the node would be too long or too short for this bus");
    set->which |= (uint16_t)cfg_change_way(&time, set, config, &change->way, ways_given(change));
    *out = time;
    return bus_takes(config, node, set) ||
           refuse(problem, "no edge is under way and no wire rings for longer than 16 of the "
                  "shortest bits");
}
