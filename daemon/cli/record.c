/* SPDX-License-Identifier: MIT
 *
 * record.c - canwire record: records the events of a bus in a file of the user.
 *
 * The daemon may not write where the user may, so events come over the control socket and the file
 * is written here.
 */
#include "base/jsonput.h"
#include "base/plain.h"
#include "base/thread.h"
#include "cli/client.h"
#include "cli/command.h"
#include "cli/record_files.h"
#include "record/event_read.h"
#include "record/recorder.h"

#include <errno.h>
#include <inttypes.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>

#define PATIENCE_S 3600u /* at the end, for pending writes */

static const char help[] =
    "Writes what happens on a bus into FILE until you press Ctrl-C: every frame, in a capture\n"
    "also error frames. The bus does not wait; how many events were lost, since this or the disk\n"
    "was too slow, is told. When FILE has reached the size it becomes FILE.1, that FILE.2 and so\n"
    "on.\n"
    "\n"
    "      --format F   candump (default for .log, .candump) or pcapng (.pcapng, for Wireshark)\n"
    "      --size S     64kB to 1000GB; default 100MB\n"
    "      --files N    that are kept, 1 to 1000; default 5\n";

typedef struct recording {
    cfg_record what;
    bool has_format;
    cfg config; /* nodes of the bus, with the members that recorders use */
    client bus;
    recorder *recorder;
    uint64_t epoch_ns; /* CLOCK_REALTIME at bus time 0 */
    uint64_t lost;     /* events that were lost on the way */
} recording;

/* ---- Options --------------------------------------------------------------------------------- */

static bool take_format(void *user, const char *text)
{
    recording *r = user;
    r->has_format = cfg_record_format_of_name(&r->what.format, text);
    if (!r->has_format)
        plain_print(stderr, "canwire record: --format %s: expected candump or pcapng\n", text);
    return r->has_format;
}

static bool take_size(void *user, const char *text)
{
    recording *r = user;
    const char *wrong = cfg_record_parse_size(&r->what.size, text);
    if (wrong)
        plain_print(stderr, "canwire record: --size %s: %s\n", text, wrong);
    return !wrong;
}

static bool take_files(void *user, const char *text)
{
    recording *r = user;
    uint64_t number = 0;
    bool good = !text_parse_uint(&number, text) && number >= 1 && number <= SPOOL_FILES_MAX;
    if (!good)
        plain_print(stderr, "canwire record: --files %s: expected a number from 1 to %u\n", text,
                    SPOOL_FILES_MAX);
    r->what.files = (uint32_t)number;
    return good;
}

/* Chooses the format. Returns -1 to go on, else the exit status. */
static int complete_format(recording *r)
{
    if (strcmp(r->what.file, "-") == 0) {
        plain_print(stderr,
                    "canwire record: -: a file is needed, which can be rotated; canwire watch "
                    "writes events to standard output\n");
        return CLI_USAGE;
    }
    if (!r->has_format && !cfg_record_format_of_file(&r->what.format, r->what.file)) {
        plain_print(
            stderr,
            "canwire record: %s: the name ends in none of .log, .candump and .pcapng: --format "
            "is needed\n",
            r->what.file);
        return CLI_USAGE;
    }
    if (r->what.format != CFG_RECORD_VCD)
        return -1;
    plain_print(stderr,
                "canwire record: VCD needs every bit, which the control socket does not carry: "
                "use 'record' in the configuration, or canwire sim --vcd\n");
    return CLI_BAD_INPUT;
}

/* ---- The bus --------------------------------------------------------------------------------- */

static void free_nodes(cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++) {
        free(config->nodes[i].name);
        free(config->nodes[i].port);
    }
    free(config->nodes);
    config->nodes = NULL;
    config->node_count = 0;
}

static char *copy_of(const json_t *text)
{
    return json_is_string(text) ? strdup(json_string_value(text)) : NULL;
}

/* Takes names and ports of the nodes. Returns false after a message. */
static bool take_nodes(recording *r, const json_t *status)
{
    const json_t *nodes = json_object_get(status, "nodes");
    size_t count = json_array_size(nodes);
    free_nodes(&r->config);
    r->config.bitrate_bps = (uint32_t)json_integer_value(
        json_object_get(json_object_get(status, "bus"), "bitrate"));
    r->config.nodes = calloc(count + 1, sizeof *r->config.nodes);
    bool good = r->config.nodes && count <= CW_NODES_MAX;
    for (size_t i = 0; i < count && good; i++) {
        const json_t *node = json_array_get(nodes, i);
        r->config.nodes[i].name = copy_of(json_object_get(node, "name"));
        r->config.nodes[i].port = copy_of(json_object_get(node, "port"));
        r->config.node_count++;
        good = r->config.nodes[i].name != NULL;
    }
    if (!good)
        plain_print(stderr, "canwire record: the status of bus %s cannot be taken\n", r->bus.bus);
    return good;
}

/* Asks for the status and, before the file is begun, checks that the bus does not use the file.
 * Returns false after a message. */
static bool ask_status(recording *r, bool first)
{
    json_t *reply = client_ask_once(r->bus.bus, client_request("status"));
    const json_t *status = json_object_get(reply, "status");
    bool good = reply && take_nodes(r, status) && (!first || record_check_files(&r->what, status));
    json_decref(reply);
    return good;
}

/* Returns false after a message. */
static bool begin_watch(recording *r)
{
    static const char *const kinds[] = {"tx",    "skip", "error", "state", "restart",
                                        "arbitration-lost", "drop"};
    size_t count = r->what.format == CFG_RECORD_CANDUMP ? 2 : sizeof kinds / sizeof kinds[0];
    json_t *request = client_request("watch");
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++)
        put_text_last(array, kinds[i]);
    put(request, "events", array);
    json_t *reply = client_ask(&r->bus, request);
    r->epoch_ns = (uint64_t)json_integer_value(json_object_get(reply, "epoch_ns"));
    json_decref(reply);
    return reply != NULL;
}

/* ---- Lines ----------------------------------------------------------------------------------- */

static void take_lost(recording *r, json_int_t count)
{
    r->lost += count > 0 ? (uint64_t)count : 0;
    plain_print(stderr,
                "canwire record: %" JSON_INTEGER_FORMAT " events lost, this reads too slowly\n",
                count);
}

/* Reads the event again with new nodes, since a reload may have changed them. */
static event_read_result look_again(recording *r, cw_event *event, uint64_t *time_ns,
                                    const json_t *line)
{
    if (!ask_status(r, false))
        return EVENT_NO_SUCH_NODE;
    recorder_nodes_changed(r->recorder, NULL);
    return event_read(event, time_ns, line, &r->config);
}

static void take_line(recording *r, const char *text)
{
    json_t *line = json_loads(text, 0, NULL);
    const json_t *lost = json_object_get(line, "lost");
    uint64_t time_ns = 0;
    cw_event event;
    event_read_result result = EVENT_OTHER;
    if (lost)
        take_lost(r, json_integer_value(lost));
    else
        result = event_read(&event, &time_ns, line, &r->config);
    if (result == EVENT_NO_SUCH_NODE)
        result = look_again(r, &event, &time_ns, line);
    if (result == EVENT_NO_SUCH_NODE || !line)
        r->lost++;
    if (result == EVENT_READ && event.kind == CW_EVENT_SKIP)
        r->epoch_ns += event.ticks / 2 * 25;
    else if (result == EVENT_READ)
        recorder_event(r->recorder, &event, r->epoch_ns + time_ns);
    json_decref(line);
}

/* ---- Start and end --------------------------------------------------------------------------- */

static volatile sig_atomic_t interrupted;
static int bus_fd = -1;

/* Stops the events; those on their way are still taken. */
static void on_signal(int number)
{
    int error = errno;
    interrupted = number;
    (void)shutdown(bus_fd, SHUT_RD);
    errno = error;
}

static void catch_signals(const recording *r)
{
    const struct sigaction action = {.sa_handler = on_signal, .sa_flags = SA_RESTART};
    bus_fd = r->bus.fd;
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
    (void)sigaction(SIGHUP, &action, NULL);
}

static int finish(recording *r)
{
    recorder_stats stats;
    const struct timespec until = thread_in_seconds(PATIENCE_S);
    (void)recorder_wait(r->recorder, &until);
    int error = recorder_error(r->recorder);
    recorder_get_stats(r->recorder, &stats);
    (void)recorder_close(r->recorder, PATIENCE_S);
    plain_print(stderr, "canwire record: %s: %" PRIu64 " entries, %" PRIu64 " bytes", r->what.file,
                stats.entries, stats.bytes);
    if (r->lost + stats.lost > 0)
        plain_print(stderr, ", %" PRIu64 " lost", r->lost + stats.lost);
    fputc('\n', stderr);
    if (error != 0)
        plain_print(stderr, "canwire record: %s: stopped: %s\n", r->what.file,
                    spool_explain(error));
    return error != 0 ? CLI_BAD_INPUT : CLI_OK;
}

static int run(recording *r)
{
    const char *line;
    int error = 0;
    if (!ask_status(r, true) || !begin_watch(r))
        return CLI_BAD_INPUT;
    r->recorder = recorder_start(&r->what, &r->config, NULL, NULL, NULL, &error);
    if (!r->recorder) {
        plain_print(stderr, "canwire record: %s: %s\n", r->what.file, spool_explain(error));
        return CLI_BAD_INPUT;
    }
    catch_signals(r);
    plain_print(stderr, "canwire record: writing %s\n", r->what.file);
    while (recorder_error(r->recorder) == 0 && (line = client_next(&r->bus)))
        take_line(r, line);
    bool good = interrupted || recorder_error(r->recorder) != 0 || client_report_end(&r->bus);
    int status = finish(r);
    return good ? status : CLI_BAD_INPUT;
}

int cli_record(int argc, char **argv)
{
    int first = 0;
    recording r = {.lost = 0};
    const command c = {.usage = "canwire record BUS FILE [--format FORMAT] [--size SIZE] "
                                "[--files N]",
                       .help = help,
                       .words_min = 2,
                       .words_max = 2,
                       .options = {{.name = "format", .text = take_format},
                                   {.name = "size", .text = take_size},
                                   {.name = "files", .text = take_files}},
                       .user = &r};
    cfg_record_default(&r.what);
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    r.what.file = argv[first + 1];
    status = complete_format(&r);
    if (status >= 0)
        return status;
    if (!client_open(&r.bus, argv[first]))
        return CLI_BAD_INPUT;
    status = run(&r);
    client_close(&r.bus);
    free_nodes(&r.config);
    return status;
}
