/* SPDX-License-Identifier: MIT
 *
 * output.c - writes the events of a bus as JSON lines and candump logs, and its statistics.
 */
#include "record/output.h"

#include "base/text/jsonput.h"
#include "base/text/jsontext.h"
#include "base/text/number.h"
#include "config/node/portname.h"
#include "record/local_time.h"
#include "record/rate_load.h"
#include "record/residual.h"
#include "trace/frametext.h"

#include <assert.h>
#include <string.h>

#define NAME_CHARACTERS "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_.-"

#define BLOCK_BYTES 4096u /* of lines that are written with one call */
#define PIECE_BYTES 32u   /* of heads and tails that are copied at once */
#define HEAD_MAX (TIME_TEXT_MAX + 16u + 48u) /* with the name of a bus */
#define TAIL_MAX 384u /* with the name of a rule or a node, and the longest frame */
#define LINE_MAX_BYTES (HEAD_MAX + CFG_NODE_NAME_MAX + TAIL_MAX)

/* Lines of one event for several nodes. Only the name of the node differs: the text before and
 * behind it is built once. */
typedef struct block {
    FILE *out;
    char *end;
    size_t head_length;
    size_t tail_length;
    char head[HEAD_MAX + PIECE_BYTES];
    char tail[TAIL_MAX + PIECE_BYTES];
    char text[BLOCK_BYTES + PIECE_BYTES];
} block;

static char *put_head(char *at, const cw_event *event);
static char *put_tail(char *at, const cfg *config, const cw_event *event);
static bool is_of_the_bus(cw_event_kind kind);
static uint64_t nodes_of(const cfg *config, const cw_event *event);
static void begin_block(block *b, FILE *out, const char *head_end, const char *tail_end);
static void end_block(block *b);
static inline void add_line(block *b, const char *name);
static json_t *stats_of_nodes(const cfg *config, const cw_bus *bus);
static json_t *stats_of_rules(const cfg *config, const cw_bus *bus);

static void output_write_event(FILE *out, const cfg *config, const cw_event *event,
                               const char *bus);

void output_event(FILE *out, const cfg *config, const cw_event *event)
{
    output_write_event(out, config, event, NULL);
}

void output_event_of_bus(FILE *out, const cfg *config, const cw_event *event)
{
    output_write_event(out, config, event, config->bus_name);
}

/* Writes the lines of an event; bus is NULL where there is only one. */
static void output_write_event(FILE *out, const cfg *config, const cw_event *event, const char *bus)
{
    block b;

    if (event->kind == CW_EVENT_TOLERATED) {
        return;
    }
    char *head_end = put_head(b.head, event);
    if (bus)
        head_end = AT_WORD(head_end, "bus", bus);
    if (is_of_the_bus(event->kind)) {
        begin_block(&b, out, head_end, put_tail(b.tail, config, event));
        add_line(&b, "");
        end_block(&b);
        return;
    }
    head_end = chars_text(head_end, ",\"node\":\"");
    b.tail[0] = '"';
    begin_block(&b, out, head_end, put_tail(b.tail + 1, config, event));
    for (uint64_t rest = nodes_of(config, event); rest != 0; rest &= rest - 1) {
        add_line(&b, config->nodes[__builtin_ctzll(rest)].name);
    }
    end_block(&b);
}

void output_log(FILE *out, const cfg *config, const cw_event *event)
{
    if (event->kind == CW_EVENT_TX) {
        output_log_at(out, config, event, text_ticks_ns(event->tick));
    }
}

void output_log_at(FILE *out, const cfg *config, const cw_event *event, uint64_t time_ns)
{
    block b;

    if (event->kind != CW_EVENT_TX) {
        return;
    }
    char *head_end = text_print_log_ns(b.head, time_ns);
    *head_end++ = ' ';
    b.tail[0] = ' ';
    char *tail_end = text_print_frame(b.tail + 1, &event->frame);
    *tail_end++ = '\n';
    begin_block(&b, out, head_end, tail_end);
    for (uint64_t rest = nodes_of(config, event); rest != 0; rest &= rest - 1) {
        const cfg_node *node = &config->nodes[__builtin_ctzll(rest)];

        add_line(&b, portname_is_interface(node->port) ? node->port : node->name);
    }
    end_block(&b);
}

json_t *output_all_stats(const cfg *config, const cw_bus *bus)
{
    json_t *root = json_object();

    put(root, "bus", output_bus_stats(config, bus));
    put(root, "nodes", stats_of_nodes(config, bus));
    put(root, "rules", stats_of_rules(config, bus));
    return root;
}

void output_stats(FILE *out, const cfg *config, const cw_bus *bus)
{
    json_t *root = output_all_stats(config, bus);

    put_out(out, root);
    json_decref(root);
}

/* ---- Lines ----------------------------------------------------------------------------------- */

/* Begins a block whose head and tail have been filled and end there. */
static void begin_block(block *b, FILE *out, const char *head_end, const char *tail_end)
{
    b->out = out;
    b->end = b->text;
    b->head_length = (size_t)(head_end - b->head);
    b->tail_length = (size_t)(tail_end - b->tail);
    assert(b->head_length <= HEAD_MAX && b->tail_length <= TAIL_MAX);
}

static void end_block(block *b)
{
    (void)fwrite(b->text, 1, (size_t)(b->end - b->text), b->out);
    b->end = b->text;
}

/* Copies a text in whole pieces, which costs less than to copy exactly its bytes. Both sides have
 * room for one more. */
static inline char *copy_pieces(char *at, const char *from, size_t length)
{
    for (size_t i = 0; i < length; i += PIECE_BYTES)
        memcpy(at + i, from + i, PIECE_BYTES);
    return at + length;
}

/* Adds a line with a name of at most CFG_NODE_NAME_MAX characters. */
static inline void add_line(block *b, const char *name)
{
    if ((size_t)(b->text + BLOCK_BYTES - b->end) < LINE_MAX_BYTES) {
        end_block(b);
    }
    char *at = copy_pieces(b->end, b->head, b->head_length);
    at = stpcpy(at, name);
    b->end = copy_pieces(at, b->tail, b->tail_length);
}

/* Returns the nodes that an event concerns. */
static uint64_t nodes_of(const cfg *config, const cw_event *event)
{
    const uint64_t all = config->node_count < CW_NODES_MAX
                             ? (UINT64_C(1) << config->node_count) - 1
                             : UINT64_MAX;

    return event->nodes & all;
}

/* ---- Events ---------------------------------------------------------------------------------- */

static bool is_of_the_bus(cw_event_kind kind)
{
    return kind == CW_EVENT_FAULT || kind == CW_EVENT_SKIP;
}

/* Names need no escaping: the configuration excludes such characters. */
static char *put_rule(char *at, const cfg *config, const cw_event *event)
{
    assert(event->rule < config->rule_count);
    const char *name = config->rules[event->rule].name;
    assert(strlen(name) < CW_RULE_NAME_MAX && name[strspn(name, NAME_CHARACTERS)] == '\0');
    at = AT_WORD(at, "rule", name);
    return AT_NUMBER(at, "hit", event->hit);
}

static char *put_frame(char *at, const cw_frame *frame)
{
    at = text_print_frame(chars_text(at, ",\"frame\":\""), frame);
    *at++ = '"';
    return at;
}

static char *put_counters(char *at, const cw_event *event)
{
    at = AT_NUMBER(at, "tec", event->tec);
    return AT_NUMBER(at, "rec", event->rec);
}

/* Index and flag are always there, stuff and rate only where they say something. */
static char *put_error(char *at, const cw_event *event)
{
    const cw_error *error = &event->error;

    at = AT_WORD(at, "role", error->role == CW_ROLE_TRANSMITTER ? "tx" : "rx");
    at = AT_WORD(at, "type", cw_error_type_name(error->type));
    at = AT_WORD(at, "field", cw_field_name(error->place.field));
    at = AT_NUMBER(at, "index", error->place.index);
    if (error->place.stuff) {
        at = chars_text(at, ",\"stuff\":true");
    }
    if (event->fast) {
        at = chars_text(at, ",\"rate\":\"data\"");
    }
    at = AT_WORD(at, "flag", cw_flag_name(error->flag));
    return put_counters(at, event);
}

/* Puts the lowest identifier that was pending, and the node with that frame. */
static char *put_pending(char *at, const cfg *config, const cw_event *event)
{
    cw_frame pending = {.id = event->pending & CW_EXTENDED_ID_MAX};
    if (event->pending & CW_FILTER_EXTENDED) {
        pending.flags = CW_FRAME_EXTENDED;
    }
    at = put_frame(at, &event->frame);
    at = text_print_frame(chars_text(at, ",\"pending\":\""), &pending) - strlen("#");
    *at++ = '"';
    if (event->from == 0) {
        return at;
    }
    return AT_WORD(at, "pending_node", config->nodes[__builtin_ctzll(event->from)].name);
}

/* A hard synchronisation moves the whole bit, it has no phase error. */
static char *put_sync(char *at, const cw_event *event)
{
    at = AT_WORD(at, "type", event->hard ? "hard" : "resync");
    if (event->hard)
        return at;
    at = AT_SIGNED(at, "phase_error_tq", event->phase_error_tq);
    return AT_SIGNED(at, "phase_error_ps", text_span_ps(event->phase_error));
}

/* Writes the details of an event beyond time, node and kind. */
static char *put_details(char *at, const cfg *config, const cw_event *event)
{
    switch (event->kind) {
    case CW_EVENT_FAULT:
        return put_rule(at, config, event);
    case CW_EVENT_LINK:
        return AT_WORD(at, "state", event->up ? "up" : "down");
    case CW_EVENT_DROP:
        at = put_frame(at, &event->frame);
        return AT_WORD(at, "why", cw_drop_name(event->why));
    case CW_EVENT_ARBITRATION_LOST:
        at = put_frame(at, &event->frame);
        return AT_NUMBER(at, "bit", event->lost_bit);
    case CW_EVENT_IMPROPER:
        return put_pending(at, config, event);
    case CW_EVENT_ERROR:
        return put_error(at, event);
    case CW_EVENT_OVERRUN:
    case CW_EVENT_RX:
        return put_frame(at, &event->frame);
    case CW_EVENT_TX:
        at = put_frame(at, &event->frame);
        return event->trigger ? AT_NUMBER(at, "late_ns", text_ticks_ns(event->late)) : at;
    case CW_EVENT_STATE:
        at = AT_WORD(at, "state", cw_state_name(event->state));
        at = put_counters(at, event);
        return event->state_before == CW_STATE_SLEEPING ? AT_WORD(at, "was", "sleeping")
                                                        : at;
    case CW_EVENT_WAKE:
        return AT_WORD(at, "by", cw_wake_name(event->why));
    case CW_EVENT_SKIP:
        return AT_NUMBER(at, "skipped_ns", text_ticks_ns(event->ticks));
    case CW_EVENT_SYNC:
        return put_sync(at, event);
    case CW_EVENT_CAPTURE:
        at = put_frame(at, &event->frame);
        return AT_NUMBER(at, "local-time", event->local_time);
    case CW_EVENT_RESTART:
    case CW_EVENT_OVERLOAD:
    case CW_EVENT_EXCEPTION:
    case CW_EVENT_TOLERATED:
    case CW_EVENT_COUNT:
        break;
    }
    return at;
}

/* Writes the text before the name of the node. */
static char *put_head(char *at, const cw_event *event)
{
    return text_print_seconds(chars_text(at, "{\"t\":"), event->tick);
}

/* Writes the text behind the name. */
static char *put_tail(char *at, const cfg *config, const cw_event *event)
{
    at = AT_WORD(at, "event", cw_event_name(event->kind));
    at = put_details(at, config, event);
    return chars_text(at, "}\n");
}

/* ---- Statistics ------------------------------------------------------------------------------ */

/* Returns the load of the whole run. */
static uint64_t load_permille(const cw_bus_stats *stats)
{
    const cw_bus_stats start = {0};

    return cw_load_permille(&start, stats);
}

/* Returns what bits of one rate take of the bus. */
static json_t *json_of_load(rate_load load)
{
    json_t *object = json_object();

    put_count(object, "bits", load.bits);
    put_ticks(object, "time_ns", load.ticks);
    put_count(object, "load_permille", load.permille);
    return object;
}

bool output_has_fd(const cfg *config, const cw_bus *bus)
{
    cw_bus_stats stats;

    cw_bus_get_stats(bus, &stats);
    return stats.fd_frames > 0 || cfg_has_fd(config);
}

static uint64_t second_permille(const cw_bus_stats *stats)
{
    return stats->load_permille;
}

uint64_t output_derived(const cw_stat *counter, const cw_bus_stats *stats)
{
    static const struct {
        const char *name;
        uint64_t (*value)(const cw_bus_stats *stats);
    } all[] = {
        {"load_permille", load_permille},
        {"load_second_permille", second_permille},
        {"error_rate_ppm", residual_error_ppm},
        {"undetected_expected_ppt", residual_expected_ppt},
    };
    size_t i = 0;

    while (strcmp(all[i].name, counter->name) != 0) {
        i++;
        assert(i < sizeof all / sizeof *all);
    }
    return all[i].value(stats);
}

/* Returns the values of a counter by their words. */
static json_t *stats_by_words(const cw_stat *counter, const void *stats)
{
    json_t *object = json_object();

    for (unsigned i = 0; i < counter->count; i++) {
        put_count(object, cw_stat_word(counter, i), cw_stat_value(counter, stats, i));
    }
    return object;
}

void output_put_counters(json_t *object, const cw_stat *counters, cw_stat_shown shown,
                         const void *stats)
{
    for (const cw_stat *c = counters; c->name; c++) {
        if (c->shown != shown) {
            continue;
        }
        if (c->form == CW_STAT_DROPS || c->form == CW_STAT_ERRORS) {
            put(object, c->name, stats_by_words(c, stats));
        } else if (c->form == CW_STAT_DERIVED) {
            put_count(object, c->name, output_derived(c, stats));
        } else {
            put_count(object, c->name, cw_stat_sum(c, stats));
        }
    }
}

/* Puts what CAN FD adds. */
static void put_fd(json_t *object, const cw_bus_stats *stats)
{
    const cw_bus_stats start = {0};

    output_put_counters(object, cw_bus_counters, CW_STAT_FD, stats);
    put(object, "nominal", json_of_load(rate_load_nominal(&start, stats)));
    put(object, "data", json_of_load(rate_load_data(&start, stats)));
}

json_t *output_bus_stats(const cfg *config, const cw_bus *bus)
{
    json_t *object = json_object();
    cw_bus_stats stats;

    cw_bus_get_stats(bus, &stats);
    put(object, "name", json_string(config->bus_name));
    put_count(object, "bitrate", config->bitrate_bps);
    put_ticks(object, "time_ns", stats.ticks);
    output_put_counters(object, cw_bus_counters, CW_STAT_USUAL, &stats);
    if (output_has_fd(config, bus)) {
        put_fd(object, &stats);
    }
    return object;
}

/* Without a frame all values are 0, and the count says so. */
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

json_t *output_node_stats(const cfg_node *node, const cw_node_stats *stats)
{
    json_t *object = json_object();

    put(object, "name", json_string(node->name));
    put_text(object, "port", node->port);
    put(object, "state", json_string(cw_state_name(stats->state)));
    put_count(object, "tec", stats->tec);
    put_count(object, "rec", stats->rec);
    output_put_counters(object, cw_node_counters, CW_STAT_USUAL, stats);
    put(object, "delay", stats_of_delay(&stats->delay));
    return object;
}

bool output_sync_stats(cw_sync_stats *stats, const cfg *config, const cw_bus *bus, unsigned node)
{
    if (cw_node_get_sync_stats(bus, node, stats) != CW_OK)
        return false;
    return cfg_has_clocks(config) || stats->hard_syncs || stats->resyncs ||
           stats->margin != CW_NO_MARGIN;
}

json_t *output_synchronisation(const cfg *config, const cw_bus *bus, unsigned node)
{
    cw_sync_stats stats;

    if (!output_sync_stats(&stats, config, bus, node))
        return json_null();
    json_t *object = json_object();
    put_count(object, "hard", stats.hard_syncs);
    put_count(object, "resync", stats.resyncs);
    put(object, "phase_error_tq", json_integer(stats.phase_error_tq));
    put(object, "phase_error_ps", json_integer(text_span_ps(stats.phase_error)));
    put(object, "margin_ps",
        stats.margin == CW_NO_MARGIN ? json_null() : json_integer(text_span_ps(stats.margin)));
    return object;
}

/* Puts what lies between controller and host, where there is something. */
static void put_host(json_t *object, const cw_bus *bus, unsigned node)
{
    cw_host_stats stats;
    cw_node_stats all;

    if (cw_node_get_host_stats(bus, node, &stats) == CW_OK &&
        cw_node_get_stats(bus, node, &all) == CW_OK) {
        output_put_counters(object, cw_host_counters, CW_STAT_HOST, &stats);
        output_put_counters(object, cw_node_counters, CW_STAT_HOST, &all);
    }
}

/* Puts the sleep of a node that has slept. */
static void put_sleep(json_t *object, const cw_bus *bus, unsigned node)
{
    cw_sleep_stats stats = {.wake_ups = 0};

    (void)cw_node_get_sleep_stats(bus, node, &stats);
    if (stats.wake_ups || stats.ticks) {
        output_put_counters(object, cw_sleep_counters, CW_STAT_SLEEP, &stats);
        put_ticks(object, "asleep_ns", stats.ticks);
    }
}

void output_put_more(json_t *object, const cw_bus *bus, unsigned node)
{
    static const cw_stat errors = {.form = CW_STAT_ERRORS,
                                      CW_STAT_MEMBER_ERRORS(cw_data_stats, , errors)};
    cw_data_stats stats;

    if (cw_node_get_data_stats(bus, node, &stats) == CW_OK) {
        put(object, "data_errors", stats_by_words(&errors, &stats));
    }
    put_host(object, bus, node);
    put_sleep(object, bus, node);
}

/* Returns the statistics of all nodes, in the order of the configuration. */
static json_t *stats_of_nodes(const cfg *config, const cw_bus *bus)
{
    json_t *array = json_array();

    for (unsigned i = 0; i < config->node_count; i++) {
        cw_node_stats stats;

        if (cw_node_get_stats(bus, i, &stats) == CW_OK) {
            json_t *object = output_node_stats(&config->nodes[i], &stats);
            put(object, "synchronisation", output_synchronisation(config, bus, i));
            output_put_more(object, bus, i);
            local_time_put(object, config, bus, i);
            put_last(array, object);
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

/* Returns the statistics of all rules, in the order of their numbers. */
static json_t *stats_of_rules(const cfg *config, const cw_bus *bus)
{
    json_t *array = json_array();

    for (unsigned i = 0; i < config->rule_count; i++) {
        put_last(array, output_rule_stats(config, bus, i));
    }
    return array;
}
