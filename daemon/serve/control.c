/* SPDX-License-Identifier: MIT
 *
 * control.c - the control socket of a bus: requests and live events as lines of JSON.
 */
#include "serve/control.h"

#include "base/text/jsonput.h"
#include "base/text/jsontext.h"
#include "base/log.h"
#include "base/text/memo.h"
#include "record/output.h"
#include "serve/requests.h"
#include "serve/server.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LOST_LINE_MAX 64
#define NAME_BYTES 64

/* A client that gets events. */
typedef struct watcher {
    uint32_t kinds; /* 1u << cw_event_kind, REQUEST_WATCH_RECORD */
    uint64_t lost;  /* lines that were lost and not yet reported to the client */
} watcher;

/* A client that waits for a reload, or until rules are saved, while the bus goes on. */
typedef struct waiter {
    json_t *reply; /* NULL: it does not wait */
    request_result of;
} waiter;

struct control {
    request_world world;
    server *server;
    watcher watchers[SERVER_CLIENTS_MAX];
    waiter waiters[SERVER_CLIENTS_MAX];
    uint32_t kinds; /* the kinds that any watcher wants */
    memo line;
    char name[NAME_BYTES]; /* of the bus, for messages */
};

/* ---- Requests -------------------------------------------------------------------------------- */

/* The engine only makes events that somebody watches: others cost time. */
static void set_watch(control *c, unsigned client, uint32_t kinds)
{
    c->watchers[client] = (watcher){.kinds = kinds};
    c->kinds = 0;
    for (unsigned i = 0; i < SERVER_CLIENTS_MAX; i++)
        c->kinds |= c->watchers[i].kinds;
    engine_set_events(c->world.engine, c->kinds & ~REQUEST_WATCH_RECORD);
}

/* Writes a value as a line to a client. */
static void write_json(server_client *client, const json_t *value)
{
    char *text = json_dumps(value, JSON_COMPACT | JSON_PRESERVE_ORDER);
    if (!text) {
        log_error("control: out of memory, a reply is left out");
        return;
    }
    size_t length = strlen(text);
    text[length] = '\n'; /* replaces the final 0 */
    server_write(client, text, length + 1);
    free(text);
}

static bool is_blank(const char *line, size_t length)
{
    return strspn(line, " \t\r") == length;
}

/* Answers a request. One that waits for something else, such as a save, gets its answer later. */
static void on_line(void *user, server_client *client, char *line, size_t length)
{
    control *c = user;
    request_result result = {.watch_changed = false};
    if (is_blank(line, length))
        return;
    const char *before = log_enter(c->name);
    json_t *reply = request_answer(&c->world, &result, line, length);
    (void)log_enter(before);
    if (result.round > 0 || result.save > 0) {
        c->waiters[server_client_number(client)] = (waiter){.reply = reply, .of = result};
        server_hold(client);
        return;
    }
    write_json(client, reply);
    json_decref(reply);
    if (result.watch_changed) {
        set_watch(c, server_client_number(client), result.watch);
        server_keep(client, result.watch != 0);
    }
}

/* Gives a client its reply, and reads on from it. */
static void control_answer(waiter *w, server_client *client)
{
    write_json(client, w->reply);
    json_decref(w->reply);
    *w = (waiter){.reply = NULL};
    server_go_on(client);
}

void control_reloaded(control *c, uint64_t round, const char *errors)
{
    for (unsigned i = 0; i < SERVER_CLIENTS_MAX; i++) {
        waiter *w = &c->waiters[i];
        server_client *client = server_client_at(c->server, i);
        if (!w->reply || w->of.round != round || !client)
            continue;
        request_reloaded(w->reply, errors);
        control_answer(w, client);
    }
}

void control_saved(control *c, uint64_t save, int error)
{
    for (unsigned i = 0; i < SERVER_CLIENTS_MAX; i++) {
        waiter *w = &c->waiters[i];
        server_client *client = server_client_at(c->server, i);
        if (!w->reply || w->of.save == 0 || w->of.save > save || !client)
            continue;
        if (error != 0 && w->of.keep)
            request_not_kept(&c->world, w->reply, error);
        else if (error != 0 && w->of.clears)
            request_not_cleared(w->reply, error);
        control_answer(w, client);
    }
}

/* ---- Events ---------------------------------------------------------------------------------- */

/* Reports lost lines to a watcher, in their place among the events. */
static void write_lost(watcher *w, server_client *client)
{
    char line[LOST_LINE_MAX];
    int length = snprintf(line, sizeof line, "{\"lost\":%" PRIu64 "}\n", w->lost);
    w->lost = 0;
    server_write(client, line, (size_t)length);
}

/* Returns the room that an event needs. After a loss it is much more, so that a slow reader gets
 * stretches of events rather than single ones. */
static size_t room_needed(const watcher *w, size_t length)
{
    return w->lost > 0 ? SERVER_STREAM_MAX / 2 + length : length;
}

/* Writes an event to a client that watches. One that reads too slowly is told how many it has
 * lost. */
static void control_write_event(control *c, unsigned number, unsigned lines)
{
    watcher *w = &c->watchers[number];
    server_client *client = server_client_at(c->server, number);
    if (server_room(client) < room_needed(w, c->line.size)) {
        w->lost += lines;
        return;
    }
    if (w->lost > 0)
        write_lost(w, client);
    server_write(client, c->line.text, c->line.size);
}

/* Formats an event once for all watchers; returns the number of its lines. */
static unsigned format_event(control *c, const cw_event *event)
{
    rewind(c->line.out);
    output_event(c->line.out, live_config(c->world.config), event);
    if (!memo_text(&c->line))
        return 0;
    return event->nodes ? (unsigned)__builtin_popcountll(event->nodes) : 1;
}

void control_event(void *self, const cw_event *event)
{
    control *c = self;
    if (!(c->kinds >> event->kind & 1u))
        return;
    unsigned lines = format_event(c, event);
    for (unsigned i = 0; lines > 0 && i < SERVER_CLIENTS_MAX; i++)
        if (c->watchers[i].kinds >> event->kind & 1u)
            control_write_event(c, i, lines);
}

/* Writes a line with "t", "event", "file", "state" and perhaps "why" to c->line.text; returns false
 * without memory. */
static bool format_recording(control *c, const char *file, const char *why)
{
    buffer line = {.data = NULL};
    jsontext_item(&line, "{");
    jsontext_seconds(&line, "t", cw_bus_now(engine_bus(c->world.engine)));
    jsontext_string(&line, "event", "record");
    jsontext_string(&line, "file", file);
    jsontext_string(&line, "state", why ? "stopped" : "recording");
    if (why)
        jsontext_string(&line, "why", why);
    const char *text = buffer_text(&line);
    rewind(c->line.out);
    bool good = text && fprintf(c->line.out, "%s}\n", text) > 0 && memo_text(&c->line);
    buffer_free(&line);
    return good;
}

void control_report_recording(control *c, const char *file, const char *why)
{
    if (!(c->kinds & REQUEST_WATCH_RECORD) || !format_recording(c, file, why))
        return;
    for (unsigned i = 0; i < SERVER_CLIENTS_MAX; i++)
        if (c->watchers[i].kinds & REQUEST_WATCH_RECORD)
            control_write_event(c, i, 1);
}

/* There is room again, so that the client hears of its losses before the next event. */
static void on_drained(void *user, server_client *client)
{
    control *c = user;
    watcher *w = &c->watchers[server_client_number(client)];
    if (w->lost > 0)
        write_lost(w, client);
}

/* Nobody waits any more for the answer of a request that goes on. */
static void on_closed(void *user, unsigned client)
{
    control *c = user;
    set_watch(c, client, 0);
    json_decref(c->waiters[client].reply);
    c->waiters[client] = (waiter){.reply = NULL};
}

/* ---- Start and stop -------------------------------------------------------------------------- */

static const server_calls calls = {
    .line = on_line,
    .drained = on_drained,
    .closed = on_closed,
    .too_many = "{\"ok\":false,\"error\":\"too many connections\"}\n",
    .too_quiet = "{\"ok\":false,\"error\":\"too many connections: this one was quiet for longest, "
                 "and another one has its place\"}\n",
    .too_long = "{\"ok\":false,\"error\":\"the line is too long\"}\n",
};

void control_on_reload(control *c, control_reload *call, void *user)
{
    c->world.reload = call;
    c->world.reload_user = user;
}

void control_keep(control *c, kept *k)
{
    c->world.kept = k;
}

void control_show_more(control *c, control_more *more, void *user)
{
    c->world.more = more;
    c->world.more_user = user;
}

control *control_start(struct ev_loop *loop, live *config, engine *bus,
                       const status_errors *errors, int inherited)
{
    control *c = calloc(1, sizeof *c);
    if (!c) {
        log_error("out of memory");
        return NULL;
    }
    c->world = (request_world){.config = config, .engine = bus, .errors = errors};
    (void)snprintf(c->name, sizeof c->name, "%s", live_config(config)->bus_name);
    if (!memo_begin(&c->line))
        log_error("out of memory");
    else
        c->server = server_start(
            loop, live_config(config)->control,
            cfg_place_text(live_config(config), live_config(config)->control_place).text, inherited,
            &calls, c);
    if (c->server)
        return c;
    control_stop(c);
    return NULL;
}

void control_stop(control *c)
{
    if (!c)
        return;
    server_stop(c->server);
    memo_end(&c->line);
    free(c);
}
