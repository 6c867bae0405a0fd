/* SPDX-License-Identifier: MIT
 *
 * retime.c - keys of a node's bit timing and of its place as texts. They change a node that is in
 * use.
 */
#include "config/retime.h"

#include "base/schema.h"
#include "timing/request.h"

#include <inttypes.h>
#include <stdarg.h>
#include <string.h>

#define CLOCK_MIN_HZ 100000u
#define CLOCK_MAX_HZ 1000000000u
#define PPM_MAX 100000u
#define MILLION 1000000

#define BIT(key) (1u << (key))
#define SEGMENTS                                                                                   \
    (BIT(RETIME_BRP) | BIT(RETIME_PROP_SEG) | BIT(RETIME_PHASE_SEG1) | BIT(RETIME_PHASE_SEG2))

/* A key whose value is a number of quanta or clocks. */
typedef struct number {
    uint32_t min;
    uint32_t max;
    size_t offset; /* in a bit_timing */
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
    [RETIME_BRP] = {1, CFG_BRP_MAX, offsetof(bit_timing, brp)},
    [RETIME_PROP_SEG] = {0, CFG_SEGMENT_MAX, offsetof(bit_timing, prop_seg)},
    [RETIME_PHASE_SEG1] = {1, CFG_SEGMENT_MAX, offsetof(bit_timing, phase_seg1)},
    [RETIME_PHASE_SEG2] = {1, CFG_SEGMENT_MAX, offsetof(bit_timing, phase_seg2)},
    [RETIME_SJW] = {1, CFG_SJW_MAX, offsetof(bit_timing, sjw)},
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

static bool put_sample_point(cfg_retime *change, char problem[RETIME_PROBLEM_MAX],
                             const char *text)
{
    const char *wrong = text_parse_sample_point(&change->sample_permille, text);
    return !wrong || refuse(problem, "sample-point: '%.40s': %s", text, wrong);
}

static bool put_number(cfg_retime *change, char problem[RETIME_PROBLEM_MAX], retime_key key,
                       const char *text)
{
    const number *n = &numbers[key];
    uint64_t value;
    if (text_parse_uint(&value, text) || value < n->min || value > n->max)
        return refuse(problem, "%s: expected a decimal integer %" PRIu32 "..%" PRIu32
                      ", not '%.40s'", names[key], n->min, n->max, text);
    *(uint32_t *)(void *)((char *)&change->bit + n->offset) = (uint32_t)value;
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
        return put_sample_point(change, problem, text);
    case RETIME_TRIPLE_SAMPLING:
        return put_triple(change, problem, text);
    case RETIME_BRP:
    case RETIME_PROP_SEG:
    case RETIME_PHASE_SEG1:
    case RETIME_PHASE_SEG2:
    case RETIME_SJW:
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
    change->given |= (uint16_t)BIT(key);
    return true;
}

static const char *print_one(char text[TIME_TEXT_MAX], const cfg_retime *values, retime_key key)
{
    const bit_timing *bit = &values->bit;
    uint32_t value = bit->clock_hz;
    if (key == RETIME_TRIPLE_SAMPLING)
        return values->triple_sampling ? "on" : "off";
    if (numbers[key].max > 0)
        memcpy(&value, (const char *)bit + numbers[key].offset, sizeof value);
    if (key == RETIME_PPM)
        (void)snprintf(text, TIME_TEXT_MAX, "%" PRId32, values->ppm);
    else if (key == RETIME_SAMPLE_POINT)
        (void)snprintf(text, TIME_TEXT_MAX, "0.%03u", (unsigned)values->sample_permille);
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

/* ---- Segments -------------------------------------------------------------------------------- */

bool cfg_fit_segments(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX])
{
    bit_timing *bit = &time->bit;
    if (bit->sjw == 0) /* as Linux does */
        bit->sjw = timing_least(bit->phase_seg1,
                                timing_least(time->limits->sjw_max, bit->phase_seg2 / 2));
    if (bit->sjw == 0)
        bit->sjw = 1;
    return timing_fits(problem, bit, time->limits);
}

/* Both rates of a node, and limits for them with one prescaler, where that is possible. */
typedef struct rates {
    timing_request nominal;
    timing_request data;
    timing_limits narrow[2];
} rates;

static void narrow_to(timing_request *request, timing_limits *narrow, uint32_t brp)
{
    *narrow = *request->limits;
    narrow->brp_min = narrow->brp_max = (uint16_t)brp;
    request->limits = narrow;
}

static void rates_of(rates *r, const cfg_node_time *time, const cfg *config)
{
    r->nominal = (timing_request){
        .limits = time->limits,
        .clock_hz = time->bit.clock_hz,
        .bitrate_bps = config->bitrate_bps,
        .sample_permille = time->sample_permille ? time->sample_permille : config->sample_permille,
        .sjw = time->bit.sjw,
    };
    r->data = (timing_request){
        .limits = timing_data_limits(time->limits),
        .clock_hz = time->bit.clock_hz,
        .bitrate_bps = config->dbitrate_bps,
        .sample_permille =
            time->dsample_permille ? time->dsample_permille : config->dsample_permille,
        .sjw = time->data.sjw,
    };
    if (config->dbitrate_bps == 0 || !r->data.limits)
        return;
    const uint32_t brp = timing_common_brp(&r->nominal, &r->data);
    if (brp == 0)
        return;
    narrow_to(&r->nominal, &r->narrow[0], brp);
    narrow_to(&r->data, &r->narrow[1], brp);
}

bool cfg_find_segments(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX], const cfg *config)
{
    rates r;
    rates_of(&r, time, config);
    time->found = true;
    return timing_by_kernel(&time->bit, problem, &r.nominal);
}

/* ---- The data phase -------------------------------------------------------------------------- */

bool cfg_find_data(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX], const cfg *config)
{
    rates r;
    rates_of(&r, time, config);
    return timing_by_kernel(&time->data, problem, &r.data);
}

bool cfg_fit_data(cfg_node_time *time, char problem[TIMING_PROBLEM_MAX])
{
    const timing_limits *limits = timing_data_limits(time->limits);
    bit_timing *data = &time->data;
    data->clock_hz = time->bit.clock_hz;
    if (data->sjw == 0)
        data->sjw = timing_least(data->phase_seg1,
                                 timing_least(limits->sjw_max, data->phase_seg2 / 2));
    if (data->sjw == 0)
        data->sjw = 1;
    return timing_fits(problem, data, limits);
}

/* As Linux does: compensation goes with a prescaler of 1 or 2, and compares at the sample point. */
static cw_tdc tdc_of(const cfg_node_time *time)
{
    const bit_timing *data = &time->data;
    const uint32_t sample_at = data->brp * (TIMING_SYNC_SEG + timing_tseg1(data));
    cw_tdc tdc = {.mode = CW_TDC_OFF};
    if (time->tdc == CFG_TDC_AUTO || (time->tdc == CFG_TDC_BY_RATE && data->brp <= 2))
        tdc.mode = CW_TDC_AUTO;
    if (time->tdc == CFG_TDC_MANUAL)
        tdc = (cw_tdc){.mode = CW_TDC_MANUAL, .tdcv = time->tdcv};
    if (tdc.mode != CW_TDC_OFF)
        tdc.tdco = time->tdco ? time->tdco : sample_at;
    return tdc;
}

cw_data_timing cfg_data_timing(const cfg_node_time *time)
{
    const bit_timing *data = &time->data;
    if (data->clock_hz == 0)
        return (cw_data_timing){.brp = 0};
    return (cw_data_timing){
        .bit = {.quantum = cw_quantum(data->clock_hz, data->brp, time->ppm),
                .prop_seg = (uint16_t)data->prop_seg,
                .phase_seg1 = (uint16_t)data->phase_seg1,
                .phase_seg2 = (uint16_t)data->phase_seg2,
                .sjw = (uint16_t)data->sjw},
        .brp = time->bit.brp,
        .data_brp = data->brp,
        .tdc = tdc_of(time),
    };
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
    const unsigned known = time->bit.clock_hz ? SEGMENTS | BIT(RETIME_SJW) | BIT(RETIME_CLOCK) : 0;
    const unsigned always = BIT(RETIME_PPM) | BIT(RETIME_TRIPLE_SAMPLING);
    const unsigned way = present_way(&time->timing, time);
    return (cfg_retime){.given = (uint16_t)(known | always | way),
                        .way = way_of(time),
                        .bit = time->bit,
                        .ppm = time->ppm,
                        .triple_sampling = time->triple_sampling};
}

static void take_numbers(bit_timing *bit, const cfg_retime *change)
{
    for (retime_key key = 0; key < RETIME_KEYS; key++)
        if (numbers[key].max > 0 && (change->given & BIT(key)))
            memcpy((char *)bit + numbers[key].offset,
                   (const char *)&change->bit + numbers[key].offset, sizeof(uint32_t));
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

cw_span cfg_drifted(cw_span quantum, cw_span ppm)
{
    return quantum - quantum / (MILLION + ppm) * ppm;
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
        !change_bit(&time, problem, config, change, &which))
        return false;
    set->which = (uint16_t)((set->which & ~CW_SET_TIMING) | which);
    set->timing = cfg_bit_timing(&time, cfg_nominal_quantum(config, node));
    if (time.data.clock_hz > 0 && (which & CW_SET_QUANTUM)) { /* else both rates would change */
        time.data.clock_hz = time.bit.clock_hz;
        set->which |= CW_SET_DATA;
        set->data = cfg_data_timing(&time);
    }
    if (!bus_takes(config, node, set))
        return refuse(problem, "a bit of the node would be too long or too short for this bus");
    set->which |= (uint16_t)cfg_change_way(&time, set, config, &change->way, ways_given(change));
    *out = time;
    return bus_takes(config, node, set) ||
           refuse(problem, "no edge is under way and no wire rings for longer than 16 of the "
                  "shortest bits");
}
