/* SPDX-License-Identifier: MIT
 *
 * metrics_page.c - the counters of all buses as text for Prometheus.
 */
#include "serve/metrics_page.h"

#include "base/text/jsonput.h"
#include "base/text/number.h"
#include "base/text/plain.h"
#include "record/output.h"

#include <inttypes.h>
#include <stdalign.h>
#include <stdio.h>
#include <string.h>

#define NAME_BYTES 96u /* of a family */

/* ---- Tables ---------------------------------------------------------------------------------- */

/* Of a bus, beyond the tables of others. */
#define METRICS_BUS(X)                                                                             \
    X(NOW, uint64_t, bitrate, TIMES, USUAL, NONE, NOWHERE, "bits a second, nominal")               \
    X(ONE, uint64_t, time_ns, NS, USUAL, NONE, NOWHERE, "of bus time since its start")             \
    X(NOW, uint64_t, lag_ns, NS, USUAL, NONE, NOWHERE, "for which it is behind real time")         \
    X(ONE, uint64_t, skips, TIMES, USUAL, NONE, NOWHERE, "it was too far behind and skipped time") \
    X(ONE, uint64_t, skipped_ns, NS, USUAL, NONE, NOWHERE, "of that time")

/* The same of a node. */
#define METRICS_NODE(X)                                                                            \
    X(NOW, uint64_t, tec, TIMES, USUAL, NONE, NOWHERE, "transmit error counter")                   \
    X(NOW, uint64_t, rec, TIMES, USUAL, NONE, NOWHERE, "receive error counter")                    \
    X(NOW, uint64_t, link_up, TIMES, USUAL, NONE, NOWHERE,                                         \
      "1: its interface is up; 0: it is down or missing, or there is no port")                     \
    X(NOW, uint64_t, pushing_back, TIMES, USUAL, NONE, NOWHERE,                                    \
      "1: its port is not read, since the queue is full")                                          \
    X(NOW, uint64_t, conserved, TIMES, USUAL, NONE, NOWHERE, "1: every frame is accounted for")    \
    X(ONE, uint64_t, delay_frames, FRAMES, USUAL, NONE, NOWHERE,                                   \
      "transmitted whose delay is known, from hand-in to end")                                     \
    X(ONE, uint64_t, delay_ns, NS, USUAL, NONE, NOWHERE, "of these delays together")               \
    X(NOW, uint64_t, delay_max_ns, NS, USUAL, NONE, NOWHERE, "of the longest of them")             \
    X(NOW, uint64_t, delay_p50_ns, NS, USUAL, NONE, NOWHERE, "that half of them did not exceed")   \
    X(NOW, uint64_t, delay_p99_ns, NS, USUAL, NONE, NOWHERE,                                       \
      "that 99 of 100 of them did not exceed")                                                     \
    X(ONE, uint64_t, rx_errors, ERRORS, USUAL, NONE, NOWHERE, "detected as a receiver")            \
    X(ONE, uint64_t, tx_errors, ERRORS, USUAL, NONE, NOWHERE, "detected as the transmitter")

#define METRICS_SYNC(X)                                                                            \
    X(ONE, uint64_t, hard_syncs, TIMES, USUAL, NONE, NOWHERE, "it synchronised hard")              \
    X(ONE, uint64_t, resyncs, TIMES, USUAL, NONE, NOWHERE,                                         \
      "it resynchronised, by a phase error other than 0")

#define METRICS_RULE(X)                                                                            \
    X(ONE, uint64_t, matches, TIMES, USUAL, NONE, NOWHERE, "a fault rule matched")                 \
    X(ONE, uint64_t, misses, TIMES, USUAL, NONE, NOWHERE, "it was passed over then")               \
    X(ONE, uint64_t, hits, TIMES, USUAL, NONE, NOWHERE, "it acted")                                \
    X(NOW, uint64_t, active, TIMES, USUAL, NONE, NOWHERE, "1: it is acting")                       \
    X(NOW, uint64_t, over, TIMES, USUAL, NONE, NOWHERE, "1: it has finished")

#define METRICS_SINK(X)                                                                            \
    X(NOW, uint64_t, good, TIMES, USUAL, NONE, NOWHERE, "1: its state is good")                    \
    X(ONE, uint64_t, written, TIMES, USUAL, NONE, NOWHERE, "something was written there")          \
    X(ONE, uint64_t, lost, TIMES, USUAL, NONE, NOWHERE, "something was not written there")         \
    X(ONE, uint64_t, bytes, BYTES, USUAL, NONE, NOWHERE, "of a recording or a journal")            \
    X(ONE, uint64_t, gaps, TIMES, USUAL, NONE, NOWHERE, "a journal has lost something")

#define METRICS_SINK_STATE(X)                                                                      \
    X(NOW, uint64_t, state, TIMES, USUAL, NONE, NOWHERE, "1, with the state that it has")

#define METRICS_VERDICTS(X)                                                                        \
    X(NOW, uint64_t, judged, TIMES, USUAL, NONE, NOWHERE,                                          \
      "expectations that the bus is judged by, with those that have failed and are gone")          \
    X(NOW, uint64_t, failed, TIMES, USUAL, NONE, NOWHERE, "expectations that have failed")

#define METRICS_GATEWAY(X)                                                                         \
    X(ONE, uint64_t, forwarded, FRAMES, USUAL, NONE, NOWHERE, "carried to the other bus")          \
    X(ONE, uint64_t, lost, FRAMES, USUAL, NONE, NOWHERE, "without room in the queue of a rule")    \
    X(ONE, uint64_t, dropped, FRAMES, USUAL, NONE, NOWHERE, "that the other node did not take")

#define METRICS_OWN(X)                                                                             \
    X(ONE, uint64_t, requests, TIMES, USUAL, NONE, NOWHERE,                                        \
      "a program asked for metrics and got them")                                                  \
    X(ONE, uint64_t, refused, TIMES, USUAL, NONE, NOWHERE, "a request was answered by an error")   \
    X(ONE, uint64_t, dropped, TIMES, USUAL, NONE, NOWHERE,                                         \
      "a connection ended without a whole answer: too slow, or gone")                              \
    X(NOW, uint64_t, clients, TIMES, USUAL, NONE, NOWHERE, "programs that are connected")

typedef struct more_of_bus { METRICS_BUS(CW_MEMBER) } more_of_bus;
typedef struct more_of_node {
    METRICS_NODE(CW_MEMBER)
    uint64_t state[CW_STATE_COUNT]; /* 1 for the one that it has */
} more_of_node;
typedef struct sync_of_node { METRICS_SYNC(CW_MEMBER) } sync_of_node;
typedef struct of_rule { METRICS_RULE(CW_MEMBER) } of_rule;
typedef struct of_sink { METRICS_SINK(CW_MEMBER) } of_sink;
typedef struct state_of_sink { METRICS_SINK_STATE(CW_MEMBER) } state_of_sink;
typedef struct of_verdicts { METRICS_VERDICTS(CW_MEMBER) } of_verdicts;
typedef struct of_gateway { METRICS_GATEWAY(CW_MEMBER) } of_gateway;

#define ROW_BUS(...) CW_STAT_ROW(more_of_bus, __VA_ARGS__)
#define ROW_NODE(...) CW_STAT_ROW(more_of_node, __VA_ARGS__)
#define ROW_SYNC(...) CW_STAT_ROW(sync_of_node, __VA_ARGS__)
#define ROW_RULE(...) CW_STAT_ROW(of_rule, __VA_ARGS__)
#define ROW_SINK(...) CW_STAT_ROW(of_sink, __VA_ARGS__)
#define ROW_SINK_STATE(...) CW_STAT_ROW(state_of_sink, __VA_ARGS__)
#define ROW_VERDICTS(...) CW_STAT_ROW(of_verdicts, __VA_ARGS__)
#define ROW_GATEWAY(...) CW_STAT_ROW(of_gateway, __VA_ARGS__)
#define ROW_OWN(...) CW_STAT_ROW(metrics_own, __VA_ARGS__)

static const cw_stat bus_rows[] = {METRICS_BUS(ROW_BUS){.name = NULL}};
static const cw_stat node_rows[] = {
    {.name = "state", .sentence = "1 for the state that it has", .form = CW_STAT_NOW,
     .unit = CW_UNIT_TIMES, .shown = CW_STAT_USUAL,
     CW_STAT_VALUES(more_of_node, state, CW_STATE_COUNT)},
    METRICS_NODE(ROW_NODE){.name = NULL}};
static const cw_stat sync_rows[] = {METRICS_SYNC(ROW_SYNC){.name = NULL}};
static const cw_stat rule_rows[] = {METRICS_RULE(ROW_RULE){.name = NULL}};
static const cw_stat sink_rows[] = {METRICS_SINK(ROW_SINK){.name = NULL}};
static const cw_stat sink_state_rows[] = {METRICS_SINK_STATE(ROW_SINK_STATE){.name = NULL}};
static const cw_stat verdict_rows[] = {METRICS_VERDICTS(ROW_VERDICTS){.name = NULL}};
static const cw_stat gateway_rows[] = {METRICS_GATEWAY(ROW_GATEWAY){.name = NULL}};
static const cw_stat own_rows[] = {METRICS_OWN(ROW_OWN){.name = NULL}};
static const cw_stat data_rows[] = {
    {.name = "data_errors", .sentence = "of these, at the data rate", .form = CW_STAT_ERRORS,
     .unit = CW_UNIT_ERRORS, .shown = CW_STAT_USUAL,
     CW_STAT_MEMBER_ERRORS(cw_data_stats, , errors)},
    {.name = NULL}};

typedef enum set {
    SET_BUS = 0,
    SET_BUS_MORE,
    SET_NODE_MORE,
    SET_NODE,
    SET_DATA,
    SET_SYNC,
    SET_HOST,
    SET_SLEEP,
    SET_INTERFACE,
    SET_TUNNEL,
    SET_RULE,
    SET_GATEWAY,
    SET_SINK,
    SET_SINK_STATE,
    SET_VERDICTS,
    SET_OWN,
    SETS
} set;

/* The tables in the order of the page, with the beginning of their names. */
static const struct {
    const char *prefix;
    const cw_stat *rows;
    size_t size; /* of the counters of one thing */
} sets[SETS] = {
    [SET_BUS] = {"canwire_bus_", cw_bus_counters, sizeof(cw_bus_stats)},
    [SET_BUS_MORE] = {"canwire_bus_", bus_rows, sizeof(more_of_bus)},
    [SET_NODE_MORE] = {"canwire_node_", node_rows, sizeof(more_of_node)},
    [SET_NODE] = {"canwire_node_", cw_node_counters, sizeof(cw_node_stats)},
    [SET_DATA] = {"canwire_node_", data_rows, sizeof(cw_data_stats)},
    [SET_SYNC] = {"canwire_node_", sync_rows, sizeof(sync_of_node)},
    [SET_HOST] = {"canwire_host_", cw_host_counters, sizeof(cw_host_stats)},
    [SET_SLEEP] = {"canwire_sleep_", cw_sleep_counters, sizeof(cw_sleep_stats)},
    [SET_INTERFACE] = {"canwire_interface_", port_counters, sizeof(port_stats)},
    [SET_TUNNEL] = {"canwire_tunnel_", port_tunnel_counters, sizeof(port_tunnel_info)},
    [SET_RULE] = {"canwire_rule_", rule_rows, sizeof(of_rule)},
    [SET_GATEWAY] = {"canwire_gateway_", gateway_rows, sizeof(of_gateway)},
    [SET_SINK] = {"canwire_sink_", sink_rows, sizeof(of_sink)},
    [SET_SINK_STATE] = {"canwire_sink_", sink_state_rows, sizeof(state_of_sink)},
    [SET_VERDICTS] = {"canwire_expectations_", verdict_rows, sizeof(of_verdicts)},
    [SET_OWN] = {"canwire_metrics_", own_rows, sizeof(metrics_own)},
};

/* The units as metrics write them: the word in the name of a counter, the one in its place, and the
 * digits behind the point. Prometheus has base units only. A bit on the wire is a time there, as
 * it is not a bit of memory. */
static const struct {
    const char *old;
    const char *name;
    unsigned digits;
} units[CW_UNIT_COUNT] = {
    [CW_UNIT_FRAMES] = {"frames", "frames", 0},
    [CW_UNIT_BYTES] = {"bytes", "bytes", 0},
    [CW_UNIT_BITS] = {"bits", "bit_times", 0},
    [CW_UNIT_ERRORS] = {"errors", "errors", 0},
    [CW_UNIT_TIMES] = {"", "", 0},
    [CW_UNIT_TICKS] = {"", "", 0},
    [CW_UNIT_NS] = {"ns", "seconds", 9},
    [CW_UNIT_PERMILLE] = {"permille", "ratio", 3},
    [CW_UNIT_PPM] = {"ppm", "ratio", 6},
    [CW_UNIT_PPT] = {"ppt", "errors", 12},
};

/* ---- What is told ---------------------------------------------------------------------------- */

/* Something that has the counters of a table. */
typedef struct thing {
    set set;
    unsigned shown; /* 1u << cw_stat_shown: those of its rows that it has */
    size_t labels;  /* their beginning; a 0 ends them */
    size_t stats;
} thing;

void metrics_page_begin(metrics_page *page, bool openmetrics)
{
    *page = (metrics_page){.openmetrics = openmetrics};
}

/* Appends the value of a label. Bytes that are not plain text are '?'. */
static void put_value(buffer *out, const char *text)
{
    uint32_t code;
    for (size_t bytes; *text; text += bytes) {
        bytes = plain_size(text) > 0 ? plain_character(&code, text) : 0;
        if (bytes == 0) {
            buffer_put(out, "?");
            bytes = 1;
        } else if (*text == '"' || *text == '\\') {
            buffer_print(out, "\\%c", *text);
        } else {
            (void)buffer_append(out, text, bytes);
        }
    }
}

/* Two labels at most that all counters of a thing have; one without a value is left out. */
typedef struct label {
    const char *key;
    const char *value;
} label;

/* Appends labels as they stand in each sample, with a final 0. Returns where they begin. */
static size_t put_labels(buffer *out, const label *labels, size_t count)
{
    const size_t begin = buffer_length(out);
    const char *between = "";
    for (size_t i = 0; i < count; i++) {
        if (!labels[i].value)
            continue;
        buffer_print(out, "%s%s=\"", between, labels[i].key);
        put_value(out, labels[i].value);
        buffer_put(out, "\"");
        between = ",";
    }
    (void)buffer_append(out, "", 1);
    return begin;
}

/* Adds a thing with a copy of its counters. */
static void add(metrics_page *page, set of, unsigned shown, size_t labels, const void *stats)
{
    static const char zeros[alignof(max_align_t)];
    const thing one = {.set = of, .shown = shown, .labels = labels,
                       .stats = buffer_length(&page->stats)};
    const size_t size = sets[of].size, rest = size % sizeof zeros;
    (void)buffer_append(&page->stats, stats, size);
    (void)buffer_append(&page->stats, zeros, rest > 0 ? sizeof zeros - rest : 0);
    (void)buffer_append(&page->things, (const char *)&one, sizeof one);
}

#define USUAL (1u << CW_STAT_USUAL)

/* Adds what lies between a node and its ECU. */
static void add_port(metrics_page *page, const cfg_node *node, const report_node *own,
                     size_t labels)
{
    port_tunnel_info tunnel;
    if (node->port)
        add(page, SET_INTERFACE, USUAL, labels, &own->interface);
    if (own->port && port_tunnel(own->port, &tunnel))
        add(page, SET_TUNNEL, USUAL, labels, &tunnel);
}

/* Adds the counters that only some nodes have. Returns what the table of nodes shows then. */
static unsigned add_some(metrics_page *page, const cfg *config, const cw_bus *bus, unsigned node,
                         size_t labels)
{
    cw_data_stats data;
    cw_sync_stats sync;
    cw_host_stats hosts;
    cw_sleep_stats sleep = {.wake_ups = 0};
    if (cw_node_get_data_stats(bus, node, &data) == CW_OK)
        add(page, SET_DATA, USUAL, labels, &data);
    if (output_sync_stats(&sync, config, bus, node))
        add(page, SET_SYNC, USUAL, labels,
            &(sync_of_node){.hard_syncs = sync.hard_syncs, .resyncs = sync.resyncs});
    (void)cw_node_get_sleep_stats(bus, node, &sleep);
    if (sleep.wake_ups || sleep.ticks)
        add(page, SET_SLEEP, 1u << CW_STAT_SLEEP, labels, &sleep);
    if (cw_node_get_host_stats(bus, node, &hosts) != CW_OK)
        return USUAL;
    add(page, SET_HOST, 1u << CW_STAT_HOST, labels, &hosts);
    return USUAL | 1u << CW_STAT_HOST;
}

static void add_node(metrics_page *page, const cfg *config, const cw_bus *bus, unsigned node,
                     const report_node *own, const status_errors *errors)
{
    cw_node_stats stats;
    const label labels[] = {{"bus", config->bus_name}, {"node", config->nodes[node].name}};
    if (cw_node_get_stats(bus, node, &stats) != CW_OK)
        return;
    const cw_delay *delay = &stats.delay;
    const size_t at = put_labels(&page->labels, labels, 2);
    more_of_node more = {
        .tec = stats.tec,
        .rec = stats.rec,
        .link_up = own->link == REPORT_LINK_UP,
        .pushing_back = own->pushed_back,
        .conserved = own->conserved,
        .delay_frames = delay->count,
        .delay_ns = text_ticks_ns(delay->sum_ticks),
        .delay_max_ns = text_ticks_ns(delay->max_ticks),
        .delay_p50_ns = text_ticks_ns(cw_delay_quantile_ticks(delay, 500)),
        .delay_p99_ns = text_ticks_ns(cw_delay_quantile_ticks(delay, 990)),
        .rx_errors = errors->rx[node],
        .tx_errors = errors->tx[node],
    };
    more.state[stats.state] = 1;
    add(page, SET_NODE_MORE, USUAL, at, &more);
    add(page, SET_NODE, add_some(page, config, bus, node, at), at, &stats);
    add_port(page, &config->nodes[node], own, at);
}

/* Adds a rule. A number without a rule is left out. */
static void put_rule(metrics_page *page, const cfg *config, const cw_bus *bus, unsigned rule)
{
    cw_rule_stats stats;
    const label labels[] = {{"bus", config->bus_name}, {"rule", config->rules[rule].name}};
    if (!config->rules[rule].name || cw_rule_get_stats(bus, rule, &stats) != CW_OK)
        return;
    add(page, SET_RULE, USUAL, put_labels(&page->labels, labels, 2),
        &(of_rule){.matches = stats.matches, .misses = stats.misses, .hits = stats.hits,
                   .active = stats.active, .over = stats.over});
}

void metrics_page_bus(metrics_page *page, const cfg *config, const cw_bus *bus,
                      const report *beyond, const status_errors *errors)
{
    cw_bus_stats stats;
    const label name = {"bus", config->bus_name};
    const size_t at = put_labels(&page->labels, &name, 1);
    cw_bus_get_stats(bus, &stats);
    add(page, SET_BUS, USUAL | (output_has_fd(config, bus) ? 1u << CW_STAT_FD : 0), at, &stats);
    add(page, SET_BUS_MORE, USUAL, at,
        &(more_of_bus){.bitrate = config->bitrate_bps, .time_ns = text_ticks_ns(stats.ticks),
                       .lag_ns = beyond->lag_ns, .skips = beyond->skips,
                       .skipped_ns = beyond->skipped_ns});
    for (unsigned i = 0; i < config->node_count; i++)
        add_node(page, config, bus, i, &beyond->nodes[i], errors);
    for (unsigned i = 0; i < config->rule_count; i++)
        put_rule(page, config, bus, i);
}

void metrics_page_sinks(metrics_page *page, const char *bus, const sink_list *all)
{
    for (size_t i = 0; i < all->count; i++) {
        const sink_info *s = &all->all[i];
        const label labels[] = {{"bus", bus}, {"kind", sink_kind_name(s->kind)},
                                {"name", s->name}, {"state", s->state}};
        add(page, SET_SINK_STATE, USUAL, put_labels(&page->labels, labels, 4),
            &(state_of_sink){.state = 1});
        add(page, SET_SINK, USUAL, put_labels(&page->labels, labels, 3),
            &(of_sink){.good = s->good, .written = s->written, .lost = s->lost, .bytes = s->bytes,
                       .gaps = s->gaps});
    }
}

void metrics_page_verdicts(metrics_page *page, const char *bus, const verdicts *all)
{
    const label name = {"bus", bus};
    if (verdicts_count(all) > 0)
        add(page, SET_VERDICTS, USUAL, put_labels(&page->labels, &name, 1),
            &(of_verdicts){.judged = verdicts_count(all), .failed = verdicts_failed(all)});
}

void metrics_page_gateways(metrics_page *page, const json_t *gateways)
{
    static const char *const directions[] = {"forward", "backward"};
    for (size_t g = 0; g < json_array_size(gateways); g++)
        for (size_t d = 0; d < 2; d++) {
            const json_t *gateway = json_array_get(gateways, g);
            const json_t *side = json_object_get(gateway, directions[d]);
            const json_t *rules = json_object_get(side, "rules");
            of_gateway all = {.dropped = get_count(side, "dropped")};
            const label labels[] = {{"gateway", get_any_text(gateway, "name")},
                                    {"direction", directions[d]}};
            for (size_t r = 0; r < json_array_size(rules); r++) {
                all.forwarded += get_count(json_array_get(rules, r), "forwarded");
                all.lost += get_count(json_array_get(rules, r), "lost");
            }
            add(page, SET_GATEWAY, USUAL, put_labels(&page->labels, labels, 2), &all);
        }
}

void metrics_page_own(metrics_page *page, const metrics_own *own)
{
    add(page, SET_OWN, USUAL, put_labels(&page->labels, NULL, 0), own);
}

/* ---- Text ------------------------------------------------------------------------------------ */

static bool is_gauge(const cw_stat *c)
{
    return c->form == CW_STAT_NOW || c->form == CW_STAT_DERIVED;
}

/* Prints the name of a family, without _total: table, name, unit. */
static void print_name(char out[NAME_BYTES], const char *prefix, const cw_stat *c)
{
    const char *old = units[c->unit].old, *unit = units[c->unit].name;
    size_t length = strlen(c->name);
    const size_t end = strlen(old);
    if (end > 0 && length >= end && strcmp(c->name + length - end, old) == 0 &&
        (length == end || c->name[length - end - 1] == '_'))
        length -= length > end ? end + 1 : end;
    (void)snprintf(out, NAME_BYTES, "%s%.*s%s%s", prefix, (int)length, c->name,
                   length > 0 && *unit ? "_" : "", unit);
}

/* Writes the lines that stand above the samples. Only the older format knows a counter by the name
 * of its samples. */
static void write_head(metrics_page *page, const char *name, const cw_stat *c)
{
    const char *unit = units[c->unit].name;
    const char *end = is_gauge(c) || page->openmetrics ? "" : "_total";
    const char *said = units[c->unit].digits > 0 ? unit : cw_unit_name(c->unit);
    const bool says_unit = (c->unit != CW_UNIT_TIMES || !is_gauge(c)) &&
                           strncmp(c->sentence, said, strlen(said)) != 0;
    buffer_print(&page->text, "# HELP %s%s %s%s%s\n", name, end,
                 says_unit ? said : "", says_unit ? " " : "", c->sentence);
    buffer_print(&page->text, "# TYPE %s%s %s\n", name, end, is_gauge(c) ? "gauge" : "counter");
    if (*unit && page->openmetrics)
        buffer_print(&page->text, "# UNIT %s %s\n", name, unit);
}

/* Returns the label of one of several values. */
static label label_of(const cw_stat *c, unsigned value)
{
    if (c->form == CW_STAT_DROPS)
        return (label){"reason", cw_stat_word(c, value)};
    if (c->form == CW_STAT_ERRORS)
        return (label){"type", cw_stat_word(c, value)};
    return (label){"state", cw_state_name((cw_state)value)};
}

/* Writes a number of a small unit in the base unit, exactly, and ends the line. */
static void write_number(buffer *out, uint64_t value, unsigned digits)
{
    uint64_t one = 1;
    for (unsigned i = 0; i < digits; i++)
        one *= 10;
    buffer_print(out, " %" PRIu64, value / one);
    if (digits > 0)
        buffer_print(out, ".%0*" PRIu64, (int)digits, value % one);
    buffer_put(out, "\n");
}

/* Writes a sample, which has a label more where a counter has several values. */
static void write_sample(metrics_page *page, const char *name, const cw_stat *c,
                         const char *labels, const label *more, uint64_t value)
{
    buffer *out = &page->text;
    buffer_put(out, name);
    buffer_put(out, is_gauge(c) ? "" : "_total");
    if (*labels || more->value) {
        buffer_print(out, "{%s%s", labels, *labels && more->value ? "," : "");
        if (more->value)
            buffer_print(out, "%s=\"%s\"", more->key, more->value);
        buffer_put(out, "}");
    }
    write_number(out, value, units[c->unit].digits);
}

/* Writes the samples of a thing. */
static void write_samples(metrics_page *page, const char *name, const cw_stat *c, const thing *t)
{
    const char *labels = buffer_first(&page->labels) + t->labels;
    const void *stats = buffer_first(&page->stats) + t->stats;
    const bool several = c->count > 1 && c->form != CW_STAT_SUM;
    for (unsigned i = 0; several && i < c->count; i++) {
        const label more = label_of(c, i);
        write_sample(page, name, c, labels, &more, cw_stat_value(c, stats, i));
    }
    if (!several)
        write_sample(page, name, c, labels, &(label){.value = NULL},
                     c->form == CW_STAT_DERIVED ? output_derived(c, stats)
                                                : cw_stat_sum(c, stats));
}

/* Writes a family, if anything has that counter. */
static void write_family(metrics_page *page, set of, const cw_stat *c)
{
    char name[NAME_BYTES];
    bool begun = false;
    const thing *things = (const thing *)(const void *)buffer_first(&page->things);
    const size_t count = buffer_length(&page->things) / sizeof *things;
    print_name(name, sets[of].prefix, c);
    for (size_t i = 0; i < count; i++) {
        if (things[i].set != of || !(things[i].shown >> c->shown & 1u))
            continue;
        if (!begun)
            write_head(page, name, c);
        begun = true;
        write_samples(page, name, c, &things[i]);
    }
}

bool metrics_page_is_good(const metrics_page *page)
{
    return !page->text.no_memory && !page->things.no_memory && !page->labels.no_memory &&
           !page->stats.no_memory;
}

bool metrics_page_write(metrics_page *page)
{
    if (page->set == SETS || !metrics_page_is_good(page))
        return false;
    const cw_stat *c = &sets[page->set].rows[page->row++];
    if (c->name) {
        write_family(page, (set)page->set, c);
        return true;
    }
    page->row = 0;
    if (++page->set == SETS && page->openmetrics)
        buffer_put(&page->text, "# EOF\n");
    return page->set < SETS;
}

buffer metrics_page_take(metrics_page *page)
{
    buffer text = page->text;
    page->text = (buffer){.data = NULL};
    metrics_page_free(page);
    return text;
}

/* May be called at any time, also for a page that has been taken. */
void metrics_page_free(metrics_page *page)
{
    buffer_free(&page->text);
    buffer_free(&page->things);
    buffer_free(&page->labels);
    buffer_free(&page->stats);
}
