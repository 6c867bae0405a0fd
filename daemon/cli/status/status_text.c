/* SPDX-License-Identifier: MIT
 *
 * status_text.c - the status of a bus as text, in the layout of `ip -details -statistics link`.
 */
#include "base/text/counted.h"
#include "base/text/jsonput.h"
#include "serve/status.h"

#include "base/text/decimal.h"
#include "cli/status/gateways_text.h"

#include <ctype.h>
#include <inttypes.h>
#include <string.h>

#define UPPER_MAX 32
#define NS_PER_S 1000000000
#define NS_PER_US 1000
#define LAG_SHOWN_MS 100 /* a smaller lag is usual on a busy machine */

/* Columns of numbers under their names, as `ip` prints them for re-started, bus-errors ... */
typedef struct column {
    const char *title;
    const char *key;
    unsigned place;
} column;

#define TITLE_WIDTH 10
#define COLUMNS_MAX 16
#define COUNT_OF(array) (sizeof(array) / sizeof((array)[0]))

static intmax_t number(const json_t *object, const char *key)
{
    return (intmax_t)json_integer_value(json_object_get(object, key));
}

/* Returns "" for a missing text. The client has made all texts plain. */
static const char *status_text_text_of(const json_t *string)
{
    const char *value = json_string_value(string);
    return value ? value : "";
}

static const char *text(const json_t *object, const char *key)
{
    return status_text_text_of(json_object_get(object, key));
}

/* Writes a word as `ip` writes states and flags. A long one is cut. */
static const char *upper(char out[UPPER_MAX], const char *word)
{
    size_t i;
    for (i = 0; word[i] && i + 1 < UPPER_MAX; i++)
        out[i] = (char)toupper((unsigned char)word[i]);
    out[i] = '\0';
    return out;
}

/* Adds up the numbers of an object: counters by type or by reason. */
static intmax_t status_text_sum(const json_t *object)
{
    intmax_t total = 0;
    json_t *members = (json_t *)(uintptr_t)object; /* the iterator does not accept a const object */
    for (void *i = json_object_iter(members); i; i = json_object_iter_next(members, i))
        total += (intmax_t)json_integer_value(json_object_iter_value(i));
    return total;
}

/* Prints the lag and the skipped time of a bus, if there is any. */
static void print_pace(FILE *out, const json_t *bus)
{
    intmax_t lag_ms = number(bus, "lag_ns") / 1000000;
    intmax_t skipped_ms = number(bus, "skipped_ns") / 1000000;
    if (lag_ms >= LAG_SHOWN_MS)
        fprintf(out, "    behind real time by %jd.%03jd s\n", lag_ms / 1000, lag_ms % 1000);
    if (skipped_ms > 0)
        fprintf(out, "    fell behind real time %jd times, skipped %jd.%03jd s\n",
                number(bus, "skips"), skipped_ms / 1000, skipped_ms % 1000);
}

/* Returns what a bus in virtual time does now. */
static const char *virtual_doing(const json_t *now)
{
    if (!json_is_true(json_object_get(now, "begun")))
        return "waits for programs";
    if (json_is_string(json_object_get(now, "runs")))
        return "holds for";
    return json_is_true(json_object_get(now, "rests")) ? "rests" : "goes on";
}

/* Prints how far virtual time is: "    virtual time, programs 2 of 2, holds for candump can0". */
static void print_virtual(FILE *out, const json_t *now)
{
    const char *runs = get_text(now, "runs");
    if (!json_is_object(now))
        return;
    fprintf(out, "    virtual time, programs %jd of %jd, %s%s%s\n", number(now, "joined"),
            number(now, "programs"), virtual_doing(now), runs ? " " : "", runs ? runs : "");
}

/* Prints the busy bits and the load by rate, on a bus with CAN FD. */
static void print_rates(FILE *out, const json_t *bus)
{
    static const char *const rates[] = {"nominal", "data"};
    if (!json_object_get(bus, "fd_frames"))
        return;
    fprintf(out, "    fd-frames %jd", number(bus, "fd_frames"));
    for (size_t i = 0; i < COUNT_OF(rates); i++) {
        const json_t *rate = json_object_get(bus, rates[i]);
        intmax_t load = number(rate, "load_permille");
        fprintf(out, " %s-bits %jd load %jd.%jd %%", rates[i], number(rate, "bits"), load / 10,
                load % 10);
    }
    fputc('\n', out);
}

/* Prints the line of a bus: times and loads have three and one digits behind the point. */
static void print_bus(FILE *out, const json_t *bus)
{
    intmax_t time_ns = number(bus, "time_ns");
    intmax_t load = number(bus, "load_second_permille");
    fprintf(out,
            "%s: bitrate %jd up %jd.%03jd s load %jd.%jd %% frames %jd error-frames %jd "
            "overload-frames %jd fault-hits %jd\n",
            text(bus, "name"), number(bus, "bitrate"), time_ns / NS_PER_S,
            time_ns % NS_PER_S / 1000000, load / 10, load % 10, number(bus, "frames"),
            number(bus, "error_frames"), number(bus, "overload_frames"), number(bus, "faults"));
    print_rates(out, bus);
    print_pace(out, bus);
}

/* Prints a mode behind `before`; the next one follows a comma. */
static void print_mode(FILE *out, const char **before, const char *name)
{
    char flag[UPPER_MAX];
    fprintf(out, "%s%s", *before, upper(flag, name));
    *before = ",";
}

/* Prints "<LISTEN-ONLY,ONE-SHOT,FD,TDC-AUTO> ", or nothing. */
static void print_modes(FILE *out, const json_t *node)
{
    const char *before = "<";
    const char *tdc = text(json_object_get(node, "data_timing"), "tdc-mode");
    const char *kind = text(node, "kind");
    json_t *members = json_object_get(node, "settings");
    for (void *i = json_object_iter(members); i; i = json_object_iter_next(members, i))
        if (json_is_true(json_object_iter_value(i)))
            print_mode(out, &before, json_object_iter_key(i));
    if (*kind && strcmp(kind, "classical") != 0)
        print_mode(out, &before, kind);
    if (json_is_true(json_object_get(node, "fd-non-iso")))
        print_mode(out, &before, "fd-non-iso");
    if (strcmp(tdc, "auto") == 0)
        print_mode(out, &before, "tdc-auto");
    if (strcmp(tdc, "manual") == 0)
        print_mode(out, &before, "tdc-manual");
    if (*before == ',')
        fputs("> ", out);
}

/* Returns true when the interface exists and is up, or the node has none. */
static bool has_link(const json_t *node)
{
    const char *link = text(node, "link");
    return *link == '\0' || strcmp(link, "up") == 0;
}

/* Prints the bit timing. A bus of an older version does not tell it. */
static void print_timing(FILE *out, const json_t *timing, intmax_t bitrate, intmax_t warning_limit)
{
    intmax_t tq_ps = number(timing, "tq_ps");
    if (!timing) {
        fprintf(out, "\t  bitrate %jd warning-limit %jd\n", bitrate, warning_limit);
        return;
    }
    fprintf(out, "\t  bitrate %jd sample-point %s warning-limit %jd\n", number(timing, "bitrate"),
            text(timing, "sample-point"), warning_limit);
    fprintf(out, "\t  tq %s prop-seg %jd phase-seg1 %jd phase-seg2 %jd sjw %jd brp %jd\n",
            decimal_signed(tq_ps, 3).text, number(timing, "prop-seg"),
            number(timing, "phase-seg1"), number(timing, "phase-seg2"), number(timing, "sjw"),
            number(timing, "brp"));
    fprintf(out, "\t  clock %jd", number(timing, "clock"));
    if (number(timing, "ppm") != 0)
        fprintf(out, " ppm %jd", number(timing, "ppm"));
    fputs(json_is_true(json_object_get(timing, "triple-sampling")) ? " triple-sampling on\n" : "\n",
          out);
}

/* Prints the bit timing of the data phase, where a node has one. */
static void print_data_timing(FILE *out, const json_t *timing)
{
    if (!json_is_object(timing))
        return;
    fprintf(out, "\t  dbitrate %jd dsample-point %s\n", number(timing, "dbitrate"),
            text(timing, "dsample-point"));
    fprintf(out, "\t  dtq %s dprop-seg %jd dphase-seg1 %jd dphase-seg2 %jd dsjw %jd dbrp %jd\n",
            decimal_signed(number(timing, "dtq_ps"), 3).text, number(timing, "dprop-seg"),
            number(timing, "dphase-seg1"), number(timing, "dphase-seg2"), number(timing, "dsjw"),
            number(timing, "dbrp"));
    if (strcmp(text(timing, "tdc-mode"), "off") != 0)
        fprintf(out, "\t  tdcv %jd tdco %jd\n", number(timing, "tdcv"), number(timing, "tdco"));
}

/* Prints local time, and what the node knows of the master's. */
static void print_local_time(FILE *out, const json_t *time)
{
    if (!json_is_object(time))
        return;
    fprintf(out, "\t  local-time %jd captures %jd", number(time, "now"), number(time, "captures"));
    if (json_is_integer(json_object_get(time, "captured")))
        fprintf(out, " captured %jd at %s", number(time, "captured"), text(time, "capture"));
    if (json_is_integer(json_object_get(time, "global")))
        fprintf(out, " global %jd of %s", number(time, "global"), text(time, "master"));
    fputc('\n', out);
}

/* Prints the counters of a trigger, and how late its frames began. */
static void print_slots(FILE *out, const json_t *trigger)
{
    fprintf(out, "\t    at %jd %s %s: slots %jd sent %jd missed %jd failed %jd arbit-lost %jd",
            number(trigger, "at"), text(trigger, "frame"), text(trigger, "window"),
            number(trigger, "slots"), number(trigger, "sent"), number(trigger, "missed"),
            number(trigger, "failed"), number(trigger, "arbitration_lost"));
    if (json_is_integer(json_object_get(trigger, "late_max_ns")))
        fprintf(out, " late %jd to %jd ns", number(trigger, "late_min_ns"),
                number(trigger, "late_max_ns"));
    fputc('\n', out);
}

/* Prints where in its cycle a time-triggered node is. */
static void print_schedule(FILE *out, const json_t *schedule)
{
    const json_t *triggers = json_object_get(schedule, "triggers");
    if (!json_is_object(schedule))
        return;
    fprintf(out, "\t  schedule cycle %jd of %jd", number(schedule, "cycle"),
            number(schedule, "cycles"));
    if (json_is_integer(json_object_get(schedule, "cycle_time")))
        fprintf(out, " cycle-time %jd", number(schedule, "cycle_time"));
    fprintf(out, " references %jd%s\n", number(schedule, "references"),
            json_is_true(json_object_get(schedule, "in_cycle")) ? "" : ", waits for the next one");
    for (size_t i = 0; i < json_array_size(triggers); i++)
        print_slots(out, json_array_get(triggers, i));
}

/* Prints how the clock of a node keeps up with the bus, where nodes have clocks of their own. */
static void print_synchronisation(FILE *out, const json_t *sync)
{
    if (!json_is_object(sync))
        return;
    fprintf(out, "\t  hard-syncs %jd resyncs %jd phase-error %jd tq (%s ns) margin ",
            number(sync, "hard"), number(sync, "resync"), number(sync, "phase_error_tq"),
            decimal_signed(number(sync, "phase_error_ps"), 3).text);
    if (json_is_integer(json_object_get(sync, "margin_ps")))
        fprintf(out, "%s ns\n", decimal_signed(number(sync, "margin_ps"), 3).text);
    else
        fputs("none\n", out);
}

/* Prints the model of the controller, where it is not as in most nodes. */
static void print_controller(FILE *out, const json_t *node)
{
    const char *model = text(node, "controller");
    if (*model && strcmp(model, "queue") != 0)
        fprintf(out, "\t  controller %s\n", model);
}

/* Prints settings of sleep that are not the defaults. */
static void print_sleep(FILE *out, const json_t *settings)
{
    static const char *const usual[][2] = {
        {"wake-filter", "5us"}, {"wake-time", "0ns"}, {"wake-on", "off"}};
    const char *before = "\t  ";
    for (size_t i = 0; i < COUNT_OF(usual); i++) {
        const char *value = text(settings, usual[i][0]);
        if (!*value || strcmp(value, usual[i][1]) == 0)
            continue;
        fprintf(out, "%s%s %s", before, usual[i][0], value);
        before = " ";
    }
    if (strcmp(before, " ") == 0)
        fputc('\n', out);
}

/* Prints state and settings in the words of `ip -details link`, as far as it has some. */
static void print_state(FILE *out, const json_t *node, intmax_t bitrate)
{
    const json_t *settings = json_object_get(node, "settings");
    char state[UPPER_MAX];
    fputs("    can ", out);
    print_modes(out, node);
    fprintf(out, "state %s (berr-counter tx %jd rx %jd) restart-ms %jd\n",
            has_link(node) ? upper(state, text(node, "state")) : "STOPPED",
            number(node, "tec"), number(node, "rec"),
            number(settings, "restart-ms"));
    print_timing(out, json_object_get(node, "timing"), bitrate, number(settings, "warning-limit"));
    print_data_timing(out, json_object_get(node, "data_timing"));
    print_synchronisation(out, json_object_get(node, "synchronisation"));
    print_controller(out, node);
    print_sleep(out, settings);
    print_local_time(out, json_object_get(node, "local-time"));
    print_schedule(out, json_object_get(node, "schedule"));
}

/* Returns the width of column i, of its name and its number; the last column ends the line. */
static int column_width(const column *columns, size_t count, size_t i)
{
    int width = (int)strlen(columns[i].title);
    if (i + 1 == count)
        return 0;
    return width > TITLE_WIDTH ? width : TITLE_WIDTH;
}

/* Prints counters below their titles, in the way of `ip -statistics`. */
static void print_columns(FILE *out, const json_t *values, const column *columns, size_t count)
{
    for (size_t i = 0; i < count; i++)
        fprintf(out, "%s%-*s", i == 0 ? "\t  " : " ", column_width(columns, count, i),
                columns[i].title);
    fputc('\n', out);
    for (size_t i = 0; i < count; i++)
        fprintf(out, "%s%-*jd", i == 0 ? "\t  " : " ", column_width(columns, count, i),
                number(values, columns[i].key));
    fputc('\n', out);
}

/* Adds the counters of a table that have a column of a line, by their places. */
static size_t add_columns(column columns[COLUMNS_MAX], size_t count, const cw_stat *counters,
                          cw_stat_line line)
{
    for (const cw_stat *c = counters; c->name && count < COLUMNS_MAX; c++) {
        size_t at = count;
        if (c->line != line)
            continue;
        for (; at > 0 && columns[at - 1].place > c->place; at--)
            columns[at] = columns[at - 1];
        columns[at] = (column){.title = c->title, .key = c->name, .place = c->place};
        count++;
    }
    return count;
}

/* Prints the counters that the tables of counters put into one line. */
static void print_line(FILE *out, const json_t *node, cw_stat_line line)
{
    column columns[COLUMNS_MAX];
    size_t count = add_columns(columns, 0, cw_host_counters, line);
    count = add_columns(columns, count, cw_node_counters, line);
    print_columns(out, node, columns, count);
}

/* Prints errors by type; their titles are longer than their names in JSON. */
static void print_error_types(FILE *out, const json_t *errors)
{
    char titles[CW_ERROR_COUNT][UPPER_MAX];
    column columns[CW_ERROR_COUNT];
    for (unsigned i = 0; i < CW_ERROR_COUNT; i++) {
        const char *type = cw_error_type_name((cw_error_type)i);
        (void)snprintf(titles[i], sizeof titles[i], "%s-err", type);
        columns[i] = (column){.title = titles[i], .key = type};
    }
    print_columns(out, errors, columns, CW_ERROR_COUNT);
}

/* Prints the reasons of a driver. A node that is printed has not been removed. */
static void print_drops(FILE *out, const json_t *dropped)
{
    column columns[CW_DROP_COUNT];
    size_t count = 0;
    for (unsigned i = 0; i < CW_DROP_COUNT; i++) {
        const char *why = cw_drop_name((cw_drop)i);
        if (i != CW_DROP_REMOVED)
            columns[count++] = (column){.title = why, .key = why};
    }
    print_columns(out, dropped, columns, count);
}

/* The part between controller and ECU is printed only for nodes whose status has its counters. */
static void print_counters(FILE *out, const json_t *node)
{
    print_line(out, node, CW_LINE_LINK);
    print_error_types(out, json_object_get(node, "errors"));
    if (json_object_get(node, "data_errors")) {
        fputs("\t  at the data rate:\n", out);
        print_error_types(out, json_object_get(node, "data_errors"));
    }
    print_line(out, node, CW_LINE_OWN);
    if (json_object_get(node, cw_host_counters[0].name)) {
        fputs("\t  between controller and ECU:\n", out);
        print_line(out, node, CW_LINE_HOST);
    }
    fputs("\t  dropped:\n", out);
    print_drops(out, json_object_get(node, "dropped"));
}

/* Prints the link statistics of a driver. Frames that the ECU's interface lost on the way to the
 * node count as dropped by the interface. */
static void print_traffic(FILE *out, const json_t *node)
{
    const json_t *interface = json_object_get(node, "interface");
    fputs("    RX:  bytes packets errors dropped  missed   mcast\n", out);
    fprintf(out, "    %10jd %7jd %6jd %7jd %7d %7d\n", number(node, "rx_bytes"),
            number(node, "rx_frames"), number(node, "rx_errors"), number(interface, "write_failed"),
            0, 0);
    fputs("    TX:  bytes packets errors dropped carrier collsns\n", out);
    fprintf(out, "    %10jd %7jd %6jd %7jd %7d %7d\n", number(node, "tx_bytes"),
            number(node, "tx_frames"), number(node, "tx_errors"),
            status_text_sum(json_object_get(node, "dropped")) +
                number(interface, "kernel_dropped") + number(interface, "loopless"),
            0, 0);
}

/* A frame whose length no DLC has is filled up, which its program may not expect. */
static void print_rounded(FILE *out, const json_t *node)
{
    intmax_t frames = number(json_object_get(node, "interface"), "rounded");
    if (frames > 0)
        fprintf(out, "    %jd CAN FD frames were longer on the bus: no DLC has their length\n",
                frames);
}

/* Prints frames that reached no receiver. */
static void print_loopless(FILE *out, const json_t *node)
{
    intmax_t frames = number(json_object_get(node, "interface"), "loopless");
    if (frames > 0)
        fprintf(out, "    %s sent without loopback %s not reached the bus: use vxcan\n",
                counted((uint64_t)frames, "frame").text, frames == 1 ? "has" : "have");
}

/* Prints failed reads; frames may wait there unread. */
static void print_read_failed(FILE *out, const json_t *node)
{
    intmax_t times = number(json_object_get(node, "interface"), "read_failed");
    if (times > 0)
        fprintf(out, "    the port could not be read %s, see the log\n",
                counted((uint64_t)times, "time").text);
}

/* Prints pauses in which programs wait for room in the queue instead of losing frames. */
static void print_push_back(FILE *out, const json_t *node)
{
    bool now = json_is_true(json_object_get(node, "pushing_back"));
    intmax_t times = number(json_object_get(node, "interface"), "pushed_back");
    if (times > 0)
        fprintf(out, "    queue full, the ECU has had to wait %s%s\n",
                counted((uint64_t)times, "time").text, now ? ", and does now" : "");
}

/* Prints how programs share a port, where that is not as on a vcan. Prints what came to the port
 * beside frames, if something did not come in. */
static void print_port(FILE *out, const json_t *node)
{
    const json_t *counts = json_object_get(node, "interface");
    const bool late = strcmp(text(node, "echo"), "sent") == 0;
    const bool told = json_is_true(json_object_get(node, "beacon"));
    const intmax_t wrong =
        number(counts, "refused") + number(counts, "gave_way") + number(counts, "malformed");
    if (late || told)
        fprintf(out, "    clients%s%s\n", late ? " echo sent" : "", told ? " beacon on" : "");
    if (wrong > 0)
        fprintf(out, "    port: connected %jd refused %jd gave-way %jd malformed %jd\n",
                number(counts, "connected"), number(counts, "refused"),
                number(counts, "gave_way"), number(counts, "malformed"));
}

/* Prints the programs at a port that share it. */
static void print_clients(FILE *out, const json_t *node)
{
    const json_t *clients = json_object_get(node, "clients");
    for (size_t i = 0; i < json_array_size(clients); i++) {
        const json_t *client = json_array_get(clients, i);
        const bool plain = json_is_null(json_object_get(client, "name"));
        const char *name = text(client, "name");
        if (plain && json_array_size(clients) == 1)
            continue;
        fprintf(out, "    %s%s%s: read %jd written %jd lost %jd\n", plain ? "ECU" : "client",
                *name ? " " : "", name, number(client, "read"), number(client, "written"),
                number(client, "lost"));
    }
}

/* Prints the tunnel at a port. */
static void print_tunnel(FILE *out, const json_t *node)
{
    const json_t *tunnel = json_object_get(node, "tunnel");
    if (!tunnel)
        return;
    fprintf(out,
            "    tunnel %s: packets read %jd written %jd missing %jd late %jd duplicate %jd "
            "malformed %jd restarts %jd strangers %jd\n",
            text(tunnel, "state"), number(tunnel, "packets_read"),
            number(tunnel, "packets_written"), number(tunnel, "missing"), number(tunnel, "late"),
            number(tunnel, "duplicate"), number(tunnel, "malformed"), number(tunnel, "restarts"),
            number(tunnel, "strangers"));
    fprintf(out, "    tunnel delay: held here up to %jd us, waited to be read up to %jd us\n",
            number(tunnel, "held_max_ns") / NS_PER_US, number(tunnel, "waited_max_ns") / NS_PER_US);
}

/* Prints a node as `ip` prints a link. Lines about what a node does not have are left out. */
static void print_node(FILE *out, const json_t *node, size_t position, intmax_t bitrate)
{
    const json_t *settings = json_object_get(node, "settings");
    const char *peer = text(node, "port");
    char link[UPPER_MAX];
    bool waits = strcmp(text(node, "when-full"), "wait") == 0;
    fprintf(out, "%zu: %s%s%s: qlen %jd order %s%s%s%s\n", position, text(node, "name"),
            *peer ? "@" : "", peer, number(settings, "queue"), text(settings, "order"),
            waits ? " when-full wait" : "", has_link(node) ? "" : " link ",
            has_link(node) ? "" : upper(link, text(node, "link")));
    print_state(out, node, bitrate);
    print_push_back(out, node);
    print_read_failed(out, node);
    print_loopless(out, node);
    print_rounded(out, node);
    print_port(out, node);
    print_clients(out, node);
    print_tunnel(out, node);
    print_counters(out, node);
    print_traffic(out, node);
}

/* Prints where programs read the counters, and how many have done so. */
static void print_metrics(FILE *out, const json_t *status)
{
    const json_t *metrics = json_object_get(status, "metrics");
    if (json_is_object(metrics))
        fprintf(out, "metrics %s: requests %jd refused %jd dropped %jd\n",
                text(metrics, "address"), number(metrics, "requests"), number(metrics, "refused"),
                number(metrics, "dropped"));
}

/* Prints "record drive.log: recording entries 12 bytes 500", and so for each sort of sink. */
static void print_sink(FILE *out, const json_t *sink)
{
    static const char *const units[][2] = {
        {"lcm", "messages"}, {"record", "entries"}, {"journal", "lines"},
        {"expect-report", "verdicts"}};
    static const char *const more[] = {"bytes", "lost", "gaps"};
    const char *why = text(sink, "why"), *kind = text(sink, "kind"), *unit = "written";
    for (size_t i = 0; i < COUNT_OF(units); i++)
        if (strcmp(kind, units[i][0]) == 0)
            unit = units[i][1];
    fprintf(out, "%s %s: %s%s%s %s %jd", kind, text(sink, "name"), text(sink, "state"),
            *why ? ": " : "", why, unit, number(sink, "written"));
    for (size_t i = 0; i < COUNT_OF(more); i++)
        if (number(sink, more[i]) > 0)
            fprintf(out, " %s %jd", more[i], number(sink, more[i]));
    fputc('\n', out);
}

/* Prints how many expectations are met, and those that have failed. */
static void print_expectations(FILE *out, const json_t *all, uint64_t left_out)
{
    size_t met = 0, failed = 0;
    for (size_t i = 0; i < json_array_size(all); i++) {
        const json_t *one = json_array_get(all, i);
        met += strcmp(text(one, "state"), "met") == 0;
        failed += strcmp(text(one, "state"), "failed") == 0;
    }
    if (json_array_size(all) > 0)
        fprintf(out, "%s: met %zu open %zu failed %zu\n",
                counted(json_array_size(all), "expectation").text, met,
                json_array_size(all) - met - failed, failed);
    if (left_out > 0)
        fprintf(out, "    and %" PRIu64 " more, for which there was no room\n", left_out);
    for (size_t i = 0; i < json_array_size(all); i++) {
        const json_t *one = json_array_get(all, i);
        const char *name = text(one, "name"), *wanted = text(one, "wanted");
        const bool named = strcmp(name, wanted) != 0;
        if (strcmp(text(one, "state"), "failed") == 0)
            fprintf(out, "    FAILED %s%swanted %s, got %s\n", named ? name : "",
                    named ? ": " : "", wanted, text(one, "got"));
    }
}

/* Prints texts of rules that are kept for the next start: "kept noise.yaml: hum, hiss". */
static void print_kept(FILE *out, const json_t *kept)
{
    for (size_t i = 0; i < json_array_size(kept); i++) {
        const json_t *one = json_array_get(kept, i), *rules = json_object_get(one, "rules");
        fprintf(out, "kept %s:", text(one, "name"));
        for (size_t k = 0; k < json_array_size(rules); k++)
            fprintf(out, "%s %s", k > 0 ? "," : "", status_text_text_of(json_array_get(rules, k)));
        if (json_is_true(json_object_get(one, "refused")))
            fprintf(out, " (refused: %s)", text(one, "why"));
        fputc('\n', out);
    }
}

/* Prints a line, unless the note is "". */
static void print_note(FILE *out, const char *what, const char *note)
{
    if (*note)
        fprintf(out, "%s%s\n", what, note);
}

void status_print(FILE *out, const json_t *status)
{
    const json_t *sinks = json_object_get(status, "sinks");
    const json_t *bus = json_object_get(status, "bus");
    const json_t *nodes = json_object_get(status, "nodes");
    print_bus(out, bus);
    print_virtual(out, json_object_get(status, "virtual"));
    for (size_t i = 0; i < json_array_size(nodes); i++)
        print_node(out, json_array_get(nodes, i), i + 1, number(bus, "bitrate"));
    for (size_t i = 0; i < json_array_size(sinks); i++)
        print_sink(out, json_array_get(sinks, i));
    print_expectations(out, json_object_get(status, "expectations"),
                       get_count(status, "expectations_left_out"));
    print_metrics(out, status);
    print_note(out, "", text(json_object_get(status, "lost_rules"), "note"));
    print_note(out, "", text(status, "unread_rules"));
    print_note(out, "", text(json_object_get(status, "lost_verdicts"), "note"));
    print_note(out, "reload refused: ", text(status, "reload_refused"));
    print_kept(out, json_object_get(status, "kept_rules"));
    gateways_print(out, json_object_get(status, "gateways"));
}

/* Returns a word for the state of a rule. */
static const char *fault_state(const json_t *fault)
{
    if (json_is_true(json_object_get(fault, "active")))
        return "active";
    if (json_is_true(json_object_get(fault, "over")))
        return "over";
    return json_is_true(json_object_get(fault, "manual")) ? "manual" : "waiting";
}

void status_print_faults(FILE *out, const json_t *faults)
{
    fprintf(out, "%-24s %-10s %-8s %8s %8s %8s %s\n", "RULE", "ACTION", "STATE", "MATCHES", "HITS",
            "MISSES", "FROM");
    for (size_t i = 0; i < json_array_size(faults); i++) {
        const json_t *fault = json_array_get(faults, i);
        bool injected = json_is_true(json_object_get(fault, "injected"));
        fprintf(out, "%-24s %-10s %-8s %8jd %8jd %8jd %s\n", text(fault, "name"),
                text(fault, "action"), fault_state(fault), number(fault, "matches"),
                number(fault, "hits"), number(fault, "misses"),
                injected ? "injection" : "configuration");
    }
}
