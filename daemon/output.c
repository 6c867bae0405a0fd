/* SPDX-License-Identifier: MIT
 *
 * output.c - writes what happens on a bus: events as JSON lines, candump logs, statistics.
 */
#include "output.h"

#include "jsonput.h"
#include "portname.h"
#include "text.h"

#include <assert.h>
#include <inttypes.h>
#include <string.h>

#define NAME_CHARACTERS "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.-"

static void write_line(FILE *out, const cfg *config, const cw_event *event, const char *node);
static json_t *stats_of_nodes(const cfg *config, const cw_bus *bus);
static json_t *stats_of_rules(const cfg *config, const cw_bus *bus);

void output_event(FILE *out, const cfg *config, const cw_event *event)
{
    if (event->kind == CW_EVENT_TOLERATED) {
        return;
    }
    if (event->kind == CW_EVENT_FAULT || event->kind == CW_EVENT_SKIP) {
        write_line(out, config, event, NULL);
        return;
    }
    for (size_t i = 0; i < config->node_count; i++) {
        if ((event->nodes >> i & 1u) != 0) {
            write_line(out, config, event, config->nodes[i].name);
        }
    }
}

void output_log(FILE *out, const cfg *config, const cw_event *event)
{
    output_log_at(out, config, event, text_ticks_ns(event->tick));
}

void output_log_at(FILE *out, const cfg *config, const cw_event *event, uint64_t time_ns)
{
    char time[TIME_TEXT_MAX];
    char frame[FRAME_TEXT_MAX];

    if (event->kind != CW_EVENT_TX) {
        return;
    }
    text_print_log_ns(time, time_ns);
    text_print_frame(frame, &event->frame);
    for (size_t i = 0; i < config->node_count; i++) {
        if ((event->nodes >> i & 1u) != 0) {
            const cfg_node *node = &config->nodes[i];

            bool interface = portname_is_interface(node->port);
            fprintf(out, "%s %s %s\n", time, interface ? node->port : node->name, frame);
        }
    }
}

void output_stats(FILE *out, const cfg *config, const cw_bus *bus)
{
    json_t *root = json_object();

    put(root, "bus", output_bus_stats(config, bus));
    put(root, "nodes", stats_of_nodes(config, bus));
    put(root, "rules", stats_of_rules(config, bus));
    put_out(out, root);
    json_decref(root);
}

/* ---- Events ---------------------------------------------------------------------------------- */

/* The configuration allows no character in names that JSON would need escaped. */
static void write_name(FILE *out, const char *key, const char *name)
{
    const size_t plain = strspn(name, NAME_CHARACTERS);
    assert(name[plain] == '\0');
    (void)plain;
    fprintf(out, ",\"%s\":\"%s\"", key, name);
}

static void write_frame(FILE *out, const cw_frame *frame)
{
    char text[FRAME_TEXT_MAX];

    text_print_frame(text, frame);
    fprintf(out, ",\"frame\":\"%s\"", text);
}

static void write_counters(FILE *out, const cw_event *event)
{
    fprintf(out, ",\"tec\":%u,\"rec\":%u", (unsigned)event->tec, (unsigned)event->rec);
}

static void write_error(FILE *out, const cw_event *event)
{
    const cw_error *error = &event->error;

    fprintf(out, ",\"role\":\"%s\",\"type\":\"%s\",\"field\":\"%s\",\"index\":%u",
            error->role == CW_ROLE_TRANSMITTER ? "tx" : "rx", cw_error_type_name(error->type),
            cw_field_name(error->place.field), (unsigned)error->place.index);
    if (error->place.stuff) {
        fputs(",\"stuff\":true", out);
    }
    fprintf(out, ",\"flag\":\"%s\"", cw_flag_name(error->flag));
    write_counters(out, event);
}

/* What an event says beyond time, node and kind. */
static void write_details(FILE *out, const cfg *config, const cw_event *event)
{
    switch (event->kind) {
    case CW_EVENT_FAULT:
        assert(event->rule < config->rule_count);
        write_name(out, "rule", config->rules[event->rule].name);
        fprintf(out, ",\"hit\":%lu", (unsigned long)event->hit);
        break;
    case CW_EVENT_LINK:
        fprintf(out, ",\"state\":\"%s\"", event->up ? "up" : "down");
        break;
    case CW_EVENT_DROP:
        write_frame(out, &event->frame);
        fprintf(out, ",\"why\":\"%s\"", cw_drop_name(event->why));
        break;
    case CW_EVENT_ARBITRATION_LOST:
        write_frame(out, &event->frame);
        fprintf(out, ",\"bit\":%u", (unsigned)event->lost_bit);
        break;
    case CW_EVENT_ERROR:
        write_error(out, event);
        break;
    case CW_EVENT_RX:
    case CW_EVENT_TX:
        write_frame(out, &event->frame);
        break;
    case CW_EVENT_STATE:
        fprintf(out, ",\"state\":\"%s\"", cw_state_name(event->state));
        write_counters(out, event);
        break;
    case CW_EVENT_SKIP:
        fprintf(out, ",\"skipped_ns\":%" PRIu64, text_ticks_ns(event->ticks));
        break;
    case CW_EVENT_RESTART:
    case CW_EVENT_OVERLOAD:
    case CW_EVENT_TOLERATED:
    case CW_EVENT_COUNT:
        break;
    }
}

/* node is NULL for an event of the bus. */
static void write_line(FILE *out, const cfg *config, const cw_event *event, const char *node)
{
    char time[TIME_TEXT_MAX];

    text_print_seconds(time, event->tick);
    fprintf(out, "{\"t\":%s", time);
    if (node != NULL) {
        write_name(out, "node", node);
    }
    fprintf(out, ",\"event\":\"%s\"", cw_event_name(event->kind));
    write_details(out, config, event);
    fputs("}\n", out);
}

/* ---- Statistics ------------------------------------------------------------------------------ */

/* Load of the whole run. */
static unsigned load_permille(const cw_bus_stats *stats)
{
    const cw_bus_stats start = {0};

    return cw_load_permille(&start, stats);
}

json_t *output_bus_stats(const cfg *config, const cw_bus *bus)
{
    json_t *object = json_object();
    cw_bus_stats stats;

    cw_bus_get_stats(bus, &stats);
    put(object, "name", json_string(config->bus_name));
    put_count(object, "bitrate", config->bitrate_bps);
    put_ticks(object, "time_ns", stats.ticks);
    put_count(object, "bits", stats.bits);
    put_count(object, "busy_bits", stats.busy_bits);
    put_count(object, "load_permille", load_permille(&stats));
    put_count(object, "load_second_permille", stats.load_permille);
    put_count(object, "frames", stats.frames);
    put_count(object, "frame_bits", stats.frame_bits);
    put_count(object, "error_frames", stats.error_frames);
    put_count(object, "overload_frames", stats.overload_frames);
    put_count(object, "arbitration_lost", stats.arbitration_lost);
    put_count(object, "undetected_errors", stats.undetected_errors);
    put_count(object, "faults", stats.faults);
    put_count(object, "pending", stats.pending);
    return object;
}

static json_t *stats_of_drops(const uint64_t dropped[CW_DROP_COUNT])
{
    json_t *object = json_object();

    for (unsigned i = 0; i < CW_DROP_COUNT; i++) {
        put_count(object, cw_drop_name((cw_drop)i), dropped[i]);
    }
    return object;
}

static json_t *stats_of_errors(const cw_node_stats *stats)
{
    json_t *object = json_object();

    for (unsigned i = 0; i < CW_ERROR_COUNT; i++) {
        put_count(object, cw_error_type_name((cw_error_type)i), stats->errors[i]);
    }
    return object;
}

static uint64_t sum_of_errors(const cw_node_stats *stats)
{
    uint64_t sum = 0;

    for (unsigned i = 0; i < CW_ERROR_COUNT; i++) {
        sum += stats->errors[i];
    }
    return sum;
}

static json_t *stats_of_delay(const cw_delay *delay)
{
    json_t *object = json_object();

    put_count(object, "count", delay->count);
    put_ticks(object, "min_ns", delay->min_ticks);
    put_ticks(object, "mean_ns", delay->count != 0 ? delay->sum_ticks / delay->count : 0);
    put_ticks(object, "max_ns", delay->max_ticks);
    put_ticks(object, "p50_ns", cw_delay_quantile_ticks(delay, 500));
    put_ticks(object, "p99_ns", cw_delay_quantile_ticks(delay, 990));
    return object;
}

/* The counters of what a node sent and received. */
static void put_traffic(json_t *object, const cw_node_stats *stats)
{
    put_count(object, "handed_in", stats->handed_in);
    put_count(object, "made_by_rules", stats->made_by_rules);
    put_count(object, "tx_frames", stats->tx_frames);
    put_count(object, "tx_bytes", stats->tx_bytes);
    put_count(object, "tx_bits", stats->tx_bits);
    put_count(object, "rx_frames", stats->rx_frames);
    put_count(object, "rx_bytes", stats->rx_bytes);
    put_count(object, "rx_accepted", stats->rx_accepted);
    put_count(object, "rx_made_by_rules", stats->rx_made_by_rules);
    put(object, "dropped", stats_of_drops(stats->dropped));
    put(object, "rx_dropped", stats_of_drops(stats->rx_dropped));
    put_count(object, "arbitration_lost", stats->arbitration_lost);
    put_count(object, "retransmissions", stats->retransmissions);
}

/* The counters of what went wrong. */
static void put_troubles(json_t *object, const cw_node_stats *stats)
{
    put(object, "errors", stats_of_errors(stats));
    put_count(object, "bus_errors", sum_of_errors(stats));
    put_count(object, "overloads", stats->overloads);
    put_count(object, "error_warning", stats->error_warning);
    put_count(object, "error_passive", stats->error_passive);
    put_count(object, "bus_off", stats->bus_off);
    put_count(object, "restarts", stats->restarts);
    put_count(object, "undetected_errors", stats->undetected_errors);
}

json_t *output_node_stats(const cfg_node *node, const cw_node_stats *stats)
{
    json_t *object = json_object();

    put(object, "name", json_string(node->name));
    put_text(object, "port", node->port);
    put(object, "state", json_string(cw_state_name(stats->state)));
    put_count(object, "tec", stats->tec);
    put_count(object, "rec", stats->rec);
    put_traffic(object, stats);
    put_troubles(object, stats);
    put_count(object, "inbox", stats->inbox);
    put_count(object, "queue", stats->queue);
    put_count(object, "queue_peak", stats->queue_peak);
    put_count(object, "held", stats->held);
    put_count(object, "rx_held", stats->rx_held);
    put(object, "delay", stats_of_delay(&stats->delay));
    return object;
}

static json_t *stats_of_nodes(const cfg *config, const cw_bus *bus)
{
    json_t *array = json_array();

    for (unsigned i = 0; i < config->node_count; i++) {
        cw_node_stats stats;

        if (cw_node_get_stats(bus, i, &stats) == CW_OK) {
            put_last(array, output_node_stats(&config->nodes[i], &stats));
        }
    }
    return array;
}

json_t *output_rule_stats(const cfg *config, const cw_bus *bus, unsigned rule)
{
    json_t *object = json_object();
    cw_rule_stats stats = {0};

    cw_rule_get_stats(bus, rule, &stats);
    put_text(object, "name", config->rules[rule].name);
    put_count(object, "matches", stats.matches);
    put_count(object, "hits", stats.hits);
    return object;
}

static json_t *stats_of_rules(const cfg *config, const cw_bus *bus)
{
    json_t *array = json_array();

    for (unsigned i = 0; i < config->rule_count; i++) {
        put_last(array, output_rule_stats(config, bus, i));
    }
    return array;
}
