/* SPDX-License-Identifier: MIT
 *
 * record_bus.c - records the events of a running bus in a file or a stream of the user.
 *
 * The daemon may not write where the user may, so events come over the control socket and are
 * written here. The bus never waits. The socket leaves out events when this reads too slowly, and
 * the recorder does so when a disk or a reader is too slow. Both count them.
 */
#include "cli/record_bus.h"

#include "base/file/fileuse.h"
#include "base/file/spool.h"
#include "base/text/counted.h"
#include "base/text/jsonput.h"
#include "base/text/plain.h"
#include "base/thread.h"
#include "cli/cli.h"
#include "cli/client.h"
#include "config/config.h"
#include "config/node/portname.h"
#include "record/event_read.h"
#include "record/recorder.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <jansson.h>
#include <limits.h>
#include <poll.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define PATIENCE_S 3600u     /* at the end, for pending writes */
#define STREAM_PATIENCE_S 2u /* for a reader that does not read */

typedef struct recording {
    const record_order *order;
    cfg config; /* nodes of the bus, with the members that recorders use */
    client bus;
    recorder *recorder;
    uint64_t epoch_ns; /* CLOCK_REALTIME at bus time 0 */
    uint64_t lost;     /* events that were lost on the way */
    uint64_t told;     /* of the entries that a slow reader has missed */
    uint64_t entries;  /* at the last look */
} recording;

/* ---- Files of the bus ------------------------------------------------------------------------ */

#define CHECK_NAME "canwire record"

typedef struct bus_files {
    fileuses uses;
    char **paths; /* of the uses, to be freed */
    size_t count;
    char folder[PATH_MAX]; /* in which canwired runs; empty: unknown */
} bus_files;

/* Finds the folder from which relative names of the bus are; "" for a process of somebody else. */
static void record_files_find_folder(char folder[PATH_MAX], const json_t *status)
{
    char link[64];
    (void)snprintf(link, sizeof link, "/proc/%jd/cwd", get_number(status, "pid"));
    ssize_t length = readlink(link, folder, PATH_MAX - 1);
    folder[length > 0 ? length : 0] = '\0';
}

/* Returns the path by which this process can open the file, to be freed. */
static char *make_path(const bus_files *files, const char *name)
{
    char *path = NULL;
    if (*name == '/' || *files->folder == '\0')
        return strdup(name);
    return asprintf(&path, "%s/%s", files->folder, name) < 0 ? NULL : path;
}

/* Returns the path of a name in the status. Returns NULL for a missing name, and without memory. */
static const char *keep_path(bus_files *files, const char *name)
{
    if (!name)
        return NULL;
    char *path = make_path(files, name);
    files->uses.incomplete = files->uses.incomplete || !path;
    if (path)
        files->paths[files->count++] = path;
    return path;
}

/* Adds a file under a name, if there is one. */
static void add_name(bus_files *files, const json_t *name, fileuse use)
{
    use.path = keep_path(files, json_string_value(name));
    if (use.path)
        fileuses_add(&files->uses, &use);
}

/* Adds the file that an object of the status names. */
static void add_file(bus_files *files, const json_t *object, fileuse use)
{
    add_name(files, json_object_get(object, "file"), use);
}

static void add_socket(bus_files *files, const char *name, const char *what)
{
    const fileuse use = {.what = what, .path = keep_path(files, name)};
    if (use.path)
        fileuses_add_socket(&files->uses, &use);
}

/* Returns true when a node before this one has the same port: guests share one. */
static bool is_shared(const json_t *nodes, size_t node, const char *port)
{
    size_t i = 0;
    while (i < node) {
        const char *text = get_text(json_array_get(nodes, i), "port");
        if (text && strcmp(text, port) == 0)
            break;
        i++;
    }
    return i < node;
}

/* Adds the socket of a port: a recording over it would cut off the ECU. */
static void add_port(bus_files *files, const json_t *nodes, size_t node)
{
    const char *text = get_text(json_array_get(nodes, node), "port");
    const portname port = portname_parse(text ? text : "");
    if (port.path && !is_shared(nodes, node, text))
        add_socket(files, port.path, "the bus' port");
}

/* Adds a "record" with its rotated files. */
static void add_recording(bus_files *files, const json_t *record)
{
    const json_int_t kept = get_number(record, "files");
    const bool rotated = kept > 1 && kept <= SPOOL_FILES_MAX;
    add_file(files, record,
             (fileuse){.what = "the bus' record",
                       .written = true,
                       .older = rotated ? (unsigned)kept - 1 : 0});
}

/* Adds the files that the bus uses: none of them may be overwritten. */
static void add_files(bus_files *files, const json_t *status)
{
    const json_t *recordings = json_object_get(status, "recordings");
    const json_t *reads = json_object_get(status, "reads");
    const json_t *nodes = json_object_get(status, "nodes");
    add_file(files, status, (fileuse){.what = "the configuration"});
    for (size_t i = 0; i < json_array_size(reads); i++)
        add_name(files, json_array_get(reads, i), (fileuse){.what = "the bus' input"});
    add_socket(files, get_text(status, "control"), "the bus' control");
    for (size_t i = 0; i < json_array_size(nodes); i++)
        add_port(files, nodes, i);
    for (size_t i = 0; i < json_array_size(recordings); i++)
        add_recording(files, json_array_get(recordings, i));
    add_file(files, json_object_get(status, "journal"),
             (fileuse){.what = "the bus' journal", .written = true});
}

/* Returns the largest number of names: besides these the configuration, the journal and the
 * socket. */
static size_t count_names(const json_t *status)
{
    return json_array_size(json_object_get(status, "recordings")) +
           json_array_size(json_object_get(status, "reads")) +
           json_array_size(json_object_get(status, "nodes")) + 3;
}

/* Compares a recording with the files in the status of a bus: its configuration, recordings and
 * journal. Returns false after messages that name both. */
static bool record_check_files(const cfg_record *what, const json_t *status)
{
    bus_files files = {.count = 0};
    const size_t most = count_names(status);
    files.paths = calloc(most, sizeof *files.paths);
    if (!files.paths) {
        fputs(CHECK_NAME ": out of memory\n", stderr);
        return false;
    }
    record_files_find_folder(files.folder, status);
    add_files(&files, status);
    fileuses_add(
        &files.uses,
        &(fileuse){.what = "", .path = what->file, .written = true, .older = what->files - 1});
    bool good = fileuses_check(&files.uses, CHECK_NAME, stderr);
    for (size_t i = 0; i < files.count; i++)
        free(files.paths[i]);
    free(files.paths);
    fileuses_free(&files.uses);
    return good;
}

/* ---- The bus --------------------------------------------------------------------------------- */

/* Frees names and ports, before those of a new status are taken. */
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
        plain_print(stderr, "%s: the status of bus %s cannot be taken\n", r->order->tool,
                    r->bus.bus);
    return good;
}

/* Asks for the status and, before the file is begun, checks that the bus does not use the file.
 * Returns false after a message. */
static bool ask_status(recording *r, bool first)
{
    json_t *reply = client_ask_exact(r->bus.bus, client_request("status"));
    const json_t *status = json_object_get(reply, "status");
    const bool check = first && r->order->stream < 0;
    bool good = reply && take_nodes(r, status) &&
                (!check || record_check_files(&r->order->what, status));
    json_decref(reply);
    return good;
}

/* Returns false after a message. */
static bool begin_watch(recording *r)
{
    static const char *const kinds[] = {"tx",    "skip", "error", "state", "restart",
                                        "arbitration-lost", "drop"};
    const bool frames = r->order->what.format == CFG_RECORD_CANDUMP || r->order->frames_only;
    size_t count = frames ? 2 : sizeof kinds / sizeof kinds[0];
    json_t *request = client_request("watch");
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++)
        put_text_last(array, kinds[i]);
    put(request, "events", array);
    json_t *reply = client_ask(&r->bus, request);
    r->epoch_ns = (uint64_t)get_number(reply, "epoch_ns");
    json_decref(reply);
    return reply != NULL;
}

/* ---- Lines ----------------------------------------------------------------------------------- */

static void take_lost(recording *r, json_int_t count)
{
    r->lost += count > 0 ? (uint64_t)count : 0;
    plain_print(stderr, "%s: %" JSON_INTEGER_FORMAT " events lost, this reads too slowly\n",
                r->order->tool, count);
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

/* Writes an event of the bus. A node that is not known is asked for: a reload may have brought
 * it. */
static void record_bus_take_line(recording *r, const char *text)
{
    json_t *line = client_parse(text, NULL);
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

/* Tells of entries that the reader of a stream has missed, once it reads again. */
static void tell_left_out(recording *r)
{
    recorder_stats stats;
    recorder_get_stats(r->recorder, &stats);
    if (stats.lost > r->told && stats.entries > r->entries) {
        plain_print(stderr, "%s: %s: %s left out, the reader is too slow\n",
                    r->order->tool, r->order->what.file,
                    counted(stats.lost - r->told, "entry").text);
        r->told = stats.lost;
    }
    r->entries = stats.entries;
}

/* ---- Start and end --------------------------------------------------------------------------- */

static volatile sig_atomic_t interrupted;
static int bus_fd = -1;
static int reader_fd = -1;

/* Ends the events; those on their way are still taken. */
static void end_events(void)
{
    (void)shutdown(bus_fd, SHUT_RD);
}

/* Ends the events, so that the loop ends after those that are there. */
static void record_bus_on_signal(int number)
{
    int error = errno;
    interrupted = number;
    end_events();
    errno = error;
}

/* Each signal ends the recording, so that the file is whole. Calls that it interrupts are
 * restarted. */
static void catch_signals(const recording *r)
{
    const struct sigaction action = {.sa_handler = record_bus_on_signal, .sa_flags = SA_RESTART};
    bus_fd = r->bus.fd;
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
    (void)sigaction(SIGHUP, &action, NULL);
}

/* Runs in the thread of a recorder that has ended. */
static void on_end(void *user)
{
    (void)user;
    end_events();
}

/* Ends the recording with the reader of its stream, also while nothing is written. */
static void *watch_reader(void *user)
{
    struct pollfd stream = {.fd = reader_fd};
    (void)user;
    while (poll(&stream, 1, -1) < 0 && errno == EINTR)
        ;
    end_events();
    return NULL;
}

static bool has_reader(const record_order *order)
{
    struct pollfd stream = {.fd = order->stream};
    return order->stream < 0 || poll(&stream, 1, 0) <= 0;
}

/* Starts the writer. Of a stream, which may be a pipe, the reader is watched: without one nothing
 * would be written, and the recording would never end. */
static bool record_bus_begin(recording *r)
{
    const record_order *order = r->order;
    int error = 0;
    const int stream = order->stream >= 0 ? fcntl(order->stream, F_DUPFD_CLOEXEC, 0) : -1;
    if (order->stream < 0)
        r->recorder = recorder_start(&order->what, &r->config, NULL, on_end, NULL, &error);
    else if (stream < 0)
        error = errno;
    else
        r->recorder = recorder_start_stream(&order->what, &r->config, stream, on_end, NULL, &error);
    reader_fd = order->stream;
    if (r->recorder && reader_fd >= 0)
        (void)thread_start_alone(watch_reader, NULL);
    if (!r->recorder)
        plain_print(stderr, "%s: %s: %s\n", order->tool, order->what.file, spool_explain(error));
    return r->recorder != NULL;
}

/* Says what was written and what was lost. A quiet recording speaks only of losses. Entries behind
 * the end of the reader are not lost: nobody wants them. */
static void tell_end(const recording *r, bool written, bool reader_gone)
{
    const char *file = r->order->what.file;
    recorder_stats stats;
    recorder_get_stats(r->recorder, &stats);
    const uint64_t lost = r->lost + (reader_gone ? r->told : stats.lost);
    if (r->order->quiet && written && lost == 0)
        return;
    plain_print(stderr, "%s: %s: %s, %s", r->order->tool, file,
                counted(stats.entries, "entry").text, counted(stats.bytes, "byte").text);
    if (lost > 0)
        plain_print(stderr, ", %" PRIu64 " lost", lost);
    fputc('\n', stderr);
    if (!written)
        plain_print(stderr, "%s: %s: the last of them are not written, nobody reads them\n",
                    r->order->tool, file);
}

/* Returns the exit status. That a reader has ended is not an error. */
static int record_bus_finish(recording *r)
{
    const bool reader = has_reader(r->order);
    const struct timespec until =
        thread_in_seconds(r->order->stream >= 0 ? STREAM_PATIENCE_S : PATIENCE_S);
    const bool written = recorder_wait(r->recorder, &until);
    int error = recorder_error(r->recorder);
    const bool reader_gone = !reader && error == EPIPE;
    if (reader_gone)
        error = 0;
    tell_end(r, written, reader_gone);
    if (error != 0)
        plain_print(stderr, "%s: %s: stopped: %s\n", r->order->tool, r->order->what.file,
                    spool_explain(error));
    (void)recorder_close(r->recorder, r->order->stream >= 0 ? 0 : PATIENCE_S);
    return error != 0 || !written ? CLI_BAD_INPUT : CLI_OK;
}

/* Records until the bus, its user, the reader or the disk ends it. */
static int record_bus_run(recording *r)
{
    const char *line;
    if (!ask_status(r, true) || !begin_watch(r))
        return CLI_BAD_INPUT;
    catch_signals(r);
    if (!record_bus_begin(r))
        return CLI_BAD_INPUT;
    if (!r->order->quiet)
        plain_print(stderr, "%s: writing %s\n", r->order->tool, r->order->what.file);
    while (recorder_error(r->recorder) == 0 && (line = client_next(&r->bus))) {
        record_bus_take_line(r, line);
        if (r->order->stream >= 0)
            tell_left_out(r);
    }
    bool good = interrupted || recorder_error(r->recorder) != 0 || !has_reader(r->order) ||
                client_report_end(&r->bus);
    int status = record_bus_finish(r);
    return good ? status : CLI_BAD_INPUT;
}

int record_bus(const char *bus, const record_order *order)
{
    recording r = {.order = order};
    if (!client_open(&r.bus, bus))
        return CLI_BAD_INPUT;
    int status = record_bus_run(&r);
    client_close(&r.bus);
    free_nodes(&r.config);
    return status;
}
