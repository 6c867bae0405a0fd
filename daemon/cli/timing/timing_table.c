/* SPDX-License-Identifier: MIT
 *
 * timing_table.c - the bit timings of a configuration, one row per node, and what they leave.
 */

#include "base/text/decimal.h"
#include "base/text/jsontext.h"
#include "base/text/wide.h"
#include "cli/timing/timing_text.h"
#include "config/node/phases.h"
#include "record/data_timing.h"

#include <inttypes.h>
#include <string.h>

#define PERMILLE_DIGITS 3u
#define TICK_PS 12500
#define PS_DIGITS 3u  /* of ns */
#define PPB_OF_PPM 3u /* digits */
#define MM_DIGITS 3u  /* of m */
#define MM_PER_M 1000u
#define PPB_PER_PERMILLE 1000000
#define PPB_PER_CENTIPERCENT 100000
#define PPB_PER_MILLIPERCENT 10000
#define COLUMNS 14
#define CELL_MAX 72 /* the longest name and its final 0 fit */

/* All nodes of a bus, and the values of one of them. */
typedef struct table {
    const cfg *config;
    timing_node nodes[CW_NODES_MAX];
} table;

typedef struct row {
    const char *name;
    const timing_node *node;
    const cfg_node_time *time;
    uint32_t sample_ppb;
    int64_t sample_error_ppb; /* against the wish */
    int64_t divider_ppb;      /* error of the bit rate by brp and segments alone */
    bool has_others;
    timing_worst worst;
    const char *clock_node; /* the names of worst */
    const char *line_node;
    bool has_line; /* the longest line is known */
    uint64_t line_mm;
} row;

/* ---- Values ---------------------------------------------------------------------------------- */

/* Returns the sample point that is wanted on the bus: its own, or what Linux takes. */
static uint32_t wanted_permille(const cfg *config)
{
    return config->sample_permille > 0 ? config->sample_permille
                                       : timing_cia_sample_permille(config->bitrate_bps);
}

/* Returns clock / (brp x tq x bit rate) - 1, rounded towards 0. */
static int64_t divider_error_ppb(const bit_timing *t, uint32_t wanted_bps)
{
    const uint64_t wanted_hz = timing_bit_clocks(t) * wanted_bps;
    const bool below = t->clock_hz < wanted_hz;
    const uint64_t error = below ? wanted_hz - t->clock_hz : t->clock_hz - wanted_hz;
    uint64_t rest;
    const int64_t ppb =
        (int64_t)wide_divide(&rest, wide_product(error, TIMING_ONE_PPB), wanted_hz).low;

    return below ? -ppb : ppb;
}

static uint64_t stubs_ps(const timing_node *a, const timing_node *b)
{
    return a->stub_ps + b->stub_ps;
}

/* Finds the node whose clock, and that whose line, leaves the least room to this one. */
static void fill_worst(row *r, const table *all, size_t i)
{
    const cfg *config = all->config;
    timing_worst *worst = &r->worst;

    *worst = timing_worst_of(all->nodes, config->node_count, i);
    r->clock_node = config->nodes[worst->clock].name;
    r->line_node = config->nodes[worst->line].name;
    const uint64_t stubs = stubs_ps(r->node, &all->nodes[worst->line]);
    const uint64_t longest = worst->line_pair.longest_ps;
    r->has_line = config->line_ps_per_m > 0;
    if (r->has_line && longest > stubs)
        r->line_mm = (longest - stubs) * MM_PER_M / config->line_ps_per_m;
}

/* Computes the row of a node. Without other nodes there is nothing that it must tolerate. */
static row row_of(const table *all, size_t i)
{
    const cfg *config = all->config;
    row r = {.name = config->nodes[i].name,
             .node = &all->nodes[i],
             .time = &config->nodes[i].time,
             .sample_ppb = timing_sample_point_ppb(&all->nodes[i].bit),
             .divider_ppb = divider_error_ppb(&all->nodes[i].bit, config->bitrate_bps),
             .has_others = config->node_count > 1};

    r.sample_error_ppb =
        (int64_t)r.sample_ppb - (int64_t)wanted_permille(config) * PPB_PER_PERMILLE;
    if (r.has_others)
        fill_worst(&r, all, i);
    return r;
}

static void fill(table *all, const cfg *config)
{
    all->config = config;
    for (size_t i = 0; i < config->node_count; i++)
        cfg_timing_node(&all->nodes[i], config, i);
}

/* ---- Text ------------------------------------------------------------------------------------ */

typedef char cells[COLUMNS][CELL_MAX];

static const char *const titles[COLUMNS] = {
    "NODE",   "TQ/NS", "SEGMENTS", "BRP",    "SAMPLE/%", "ERROR/%",   "CLOCK/PPM",
    "RATE/PPM", "LEFT/%", "SURE/%",   "TO NODE", "LINE/M",   "TO NODE", "RESYNCS",
};

static void put_cell(cells c, size_t column, const char *value)
{
    snprintf(c[column], CELL_MAX, "%s", value);
}

/* Rounds down, so that nothing looks like more than it is. */
static int64_t floor_divide(int64_t number, int64_t by)
{
    return number / by - (number % by < 0);
}

static decimal_text percent(int64_t ppb)
{
    return decimal_signed(floor_divide(ppb, PPB_PER_MILLIPERCENT), 3);
}

static decimal_text rounded_percent(int64_t ppb)
{
    return decimal_signed(ppb / PPB_PER_CENTIPERCENT, 2);
}

/* Fills the columns about other nodes, "-" where there are none. */
static void put_worst(cells c, const row *r)
{
    const timing_worst *worst = &r->worst;

    for (size_t column = 8; column < COLUMNS; column++)
        put_cell(c, column, "-");
    if (!r->has_others)
        return;
    put_cell(c, 8, percent(timing_tolerance_left_ppb(&worst->clock_pair)).text);
    put_cell(c, 9, percent(timing_sufficient_left_ppb(&worst->clock_pair)).text);
    put_cell(c, 10, r->clock_node);
    if (r->has_line)
        put_cell(c, 11, decimal(r->line_mm, MM_DIGITS).text);
    put_cell(c, 12, r->line_node);
    snprintf(c[13], CELL_MAX, "%u", worst->resynchronisations);
}

/* Fills the columns of a node, in the order of the titles. */
static void put_row(cells c, const row *r)
{
    const bit_timing *t = &r->node->bit;

    put_cell(c, 0, r->name);
    put_cell(c, 1, decimal(timing_quanta_ps(t, 1), PS_DIGITS).text);
    snprintf(c[2], CELL_MAX, "%" PRIu32 "-%" PRIu32 "-%" PRIu32 "/%" PRIu32, t->prop_seg,
             t->phase_seg1, t->phase_seg2, t->sjw);
    snprintf(c[3], CELL_MAX, "%" PRIu32, t->brp);
    put_cell(c, 4, rounded_percent(r->sample_ppb).text);
    put_cell(c, 5, rounded_percent(r->sample_error_ppb).text);
    snprintf(c[6], CELL_MAX, "%" PRId32, r->node->ppm);
    put_cell(c, 7, decimal_signed(r->divider_ppb, PPB_OF_PPM).text);
    put_worst(c, r);
}

static void widen(int widths[COLUMNS], cells c)
{
    for (size_t i = 0; i < COLUMNS; i++)
        if ((int)strlen(c[i]) > widths[i])
            widths[i] = (int)strlen(c[i]);
}

static bool is_name(size_t column)
{
    return column == 0 || column == 10 || column == 12;
}

/* Numbers stand at the right of their columns, names at the left. */
static void print_cells(FILE *out, const int widths[COLUMNS], cells c)
{
    for (size_t i = 0; i < COLUMNS; i++)
        fprintf(out, "%s%*s", i == 0 ? "" : "  ", is_name(i) ? -widths[i] : widths[i], c[i]);
    fputc('\n', out);
}

static void print_bus(FILE *out, const cfg *config)
{
    fprintf(out, "bus %s: bitrate %" PRIu32 " sample-point %s line-delay %s ns/m\n",
            config->bus_name, config->bitrate_bps,
            decimal(wanted_permille(config), PERMILLE_DIGITS).text,
            decimal(config->line_ps_per_m, PS_DIGITS).text);
}

/* ---- Text of the data phase ------------------------------------------------------------------ */

/* Rounds to the nearest picosecond, since delays are not whole ticks. */
static decimal_text nanoseconds(cw_span span)
{
    const cw_span half_ps = CW_TICK / (2 * TICK_PS);
    return decimal_signed(text_span_ps(span < 0 ? span - half_ps : span + half_ps), PS_DIGITS);
}

/* Prints where the node compares its bits, and the time from there to where they are not back. */
static void print_compensation(FILE *out, const row *r)
{
    const cw_tdc *tdc = &r->time->timing.data.tdc;
    const cfg_late_sample sample = cfg_find_late_sample(r->time);
    const decimal_text margin = nanoseconds(cfg_late_margin(&sample));

    if (tdc->mode == CW_TDC_OFF)
        fprintf(out, "  %4s  %4s  %7s  %9s\n", "-", "-", "-", margin.text);
    else
        fprintf(out, "  %4" PRIu64 "  %4" PRIu32 "  %7s  %9s\n", sample.tdcv, tdc->tdco,
                nanoseconds(sample.at).text, margin.text);
}

/* Prints the data phase of a node. Transmitter delay compensation follows it. */
static void print_data_row(FILE *out, int name_width, const row *r)
{
    const bit_timing *data = &r->time->phase[1].bit;
    const cw_tdc *tdc = &r->time->timing.data.tdc;
    char segments[CELL_MAX];

    snprintf(segments, sizeof segments, "%" PRIu32 "-%" PRIu32 "-%" PRIu32 "/%" PRIu32,
             data->prop_seg, data->phase_seg1, data->phase_seg2, data->sjw);
    fprintf(out, "%*s  %6s  %11s  %4" PRIu32 "  %8s  %11s  %6s", -name_width, r->name,
            decimal(timing_quanta_ps(data, 1), PS_DIGITS).text, segments, data->brp,
            rounded_percent(timing_sample_point_ppb(data)).text,
            percent(timing_data_tolerance_ppb(&r->node->bit, data)).text,
            data_timing_tdc_name(tdc->mode));
    print_compensation(out, r);
}

/* Prints the nodes that have a data phase, if any has. */
static void print_data_table(FILE *out, const table *all)
{
    const cfg *config = all->config;
    size_t width = strlen(titles[0]);

    if (config->dbitrate_bps == 0)
        return;
    for (size_t i = 0; i < config->node_count; i++)
        if (strlen(config->nodes[i].name) > width)
            width = strlen(config->nodes[i].name);
    fprintf(out, "\ndata phase: dbitrate %" PRIu32 "\n", config->dbitrate_bps);
    fprintf(out, "%*s  %6s  %11s  %4s  %8s  %11s  %6s  %4s  %4s  %7s  %9s\n", -(int)width,
            titles[0], "DTQ/NS", "SEGMENTS", "DBRP", "SAMPLE/%", "TOLERANCE/%", "TDC", "TDCV",
            "TDCO", "SSP/NS", "MARGIN/NS");
    for (size_t i = 0; i < config->node_count; i++) {
        const row r = row_of(all, i);
        if (r.time->phase[1].bit.clock_hz > 0)
            print_data_row(out, (int)width, &r);
    }
}

void timing_table_print(FILE *out, const cfg *config)
{
    int widths[COLUMNS] = {0};
    table all;
    cells c;

    fill(&all, config);
    print_bus(out, config);
    for (size_t i = 0; i < COLUMNS; i++)
        put_cell(c, i, titles[i]);
    widen(widths, c);
    for (size_t i = 0; i < config->node_count; i++) {
        const row r = row_of(&all, i);
        put_row(c, &r);
        widen(widths, c);
    }
    for (size_t i = 0; i < COLUMNS; i++)
        put_cell(c, i, titles[i]);
    print_cells(out, widths, c);
    for (size_t i = 0; i < config->node_count; i++) {
        const row r = row_of(&all, i);
        put_row(c, &r);
        print_cells(out, widths, c);
    }
    print_data_table(out, &all);
}

/* ---- JSON ------------------------------------------------------------------------------------ */

/* Puts what depends on other nodes. */
static void put_worst_json(buffer *out, const row *r)
{
    const timing_worst *worst = &r->worst;

    timing_put_fraction(out, "tolerance-left", timing_tolerance_left_ppb(&worst->clock_pair));
    timing_put_fraction(out, "sufficient-left", timing_sufficient_left_ppb(&worst->clock_pair));
    jsontext_string(out, "clock-node", r->clock_node);
    jsontext_number(out, "resynchronisations", worst->resynchronisations);
    jsontext_value(out, "round-trip", decimal(worst->line_pair.round_trip_ps, PS_DIGITS).text);
    jsontext_value(out, "longest-line", r->has_line ? decimal(r->line_mm, MM_DIGITS).text : "null");
    jsontext_string(out, "line-node", r->line_node);
}

/* Puts the data phase of a CAN FD node. */
static void put_data_json(buffer *out, const row *r)
{
    const cw_tdc *tdc = &r->time->timing.data.tdc;
    const cfg_late_sample sample = cfg_find_late_sample(r->time);

    timing_put_data(out, &r->node->bit, &r->time->phase[1].bit);
    jsontext_string(out, "tdc-mode", data_timing_tdc_name(tdc->mode));
    if (tdc->mode != CW_TDC_OFF) {
        jsontext_number(out, "tdco", tdc->tdco);
        jsontext_number(out, "tdcv", sample.tdcv);
        jsontext_value(out, "secondary-sample", nanoseconds(sample.at).text);
    }
    jsontext_value(out, "sample-margin", nanoseconds(cfg_late_margin(&sample)).text);
}

/* Keys have the names of the configuration. A node alone has no keys about others. */
static void put_row_json(buffer *out, const row *r)
{
    const bit_timing *t = &r->node->bit;

    jsontext_item(out, "{");
    jsontext_string(out, "name", r->name);
    jsontext_number(out, "clock", t->clock_hz);
    jsontext_value(out, "tq", decimal(timing_quanta_ps(t, 1), PS_DIGITS).text);
    timing_put_segments(out, t, false);
    timing_put_fraction(out, "sample-point", r->sample_ppb);
    timing_put_fraction(out, "sample-point-error", r->sample_error_ppb);
    jsontext_value(out, "ppm", decimal_signed(r->node->ppm, 0).text);
    jsontext_value(out, "bitrate-error", decimal_signed(r->divider_ppb, PPB_OF_PPM).text);
    timing_put_fraction(out, "tolerance", timing_tolerance_ppb(t));
    timing_put_fraction(out, "sufficient", timing_sufficient_ppb(t));
    if (r->has_others)
        put_worst_json(out, r);
    if (r->time->phase[1].bit.clock_hz > 0)
        put_data_json(out, r);
    buffer_put(out, "}");
}

void timing_table_print_json(FILE *out, const cfg *config)
{
    buffer text = {.data = NULL};
    table all;

    fill(&all, config);
    buffer_put(&text, "{");
    jsontext_string(&text, "bus", config->bus_name);
    jsontext_number(&text, "bitrate", config->bitrate_bps);
    jsontext_value(&text, "sample-point", decimal(wanted_permille(config), PERMILLE_DIGITS).text);
    if (config->dbitrate_bps > 0)
        jsontext_number(&text, "dbitrate", config->dbitrate_bps);
    jsontext_value(&text, "nodes", "[");
    for (size_t i = 0; i < config->node_count; i++) {
        const row r = row_of(&all, i);
        put_row_json(&text, &r);
    }
    buffer_put(&text, "]}");
    jsontext_out(&text, out);
}
