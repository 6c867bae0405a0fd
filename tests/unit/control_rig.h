/* SPDX-License-Identifier: MIT
 *
 * control_rig.h - a bus with a control socket for unit tests, and clients of it.
 *
 * Server and clients are in this process, on a real socket in a folder of its own. The engine is
 * the fake of fake_engine.h.
 */
#ifndef CANWIRE_TEST_CONTROL_RIG_H
#define CANWIRE_TEST_CONTROL_RIG_H

#include "cases.h"
#include "fake_engine.h"
#include "serve/control.h"

#include <errno.h>
#include <jansson.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define PATIENCE_TURNS 200000 /* of the loop, until something that must come counts as missing */
#define UPDATE_BITS 2000

/* ---- A bus with a control socket ------------------------------------------------------------- */

typedef struct rig {
    char folder[32];
    char path[64];
    const char *config; /* its text, without `control` */
    struct ev_loop *loop;
    live *live;
    engine engine;
    control *control;
    status_errors errors; /* none: nobody counts them */
    bool reloads_take_long;
} rig;

static const char config_text[] =
    "bus: { name: test, bitrate: 500000 }\n"
    "nodes: [ { name: a, warning-limit: 90 }, { name: b }, { name: c, restart-ms: 100 } ]\n"
    "faults:\n"
    "  - { name: configured, when: { frame: \"7FF\" }, do: { flip: \"crc[3]\" } }\n";

static inline cfg *load(const rig *r)
{
    char file[96];
    snprintf(file, sizeof file, "%s/bus.yaml", r->folder);
    FILE *out = fopen(file, "we");
    assert_non_null(out);
    fprintf(out, "%scontrol: %s\n", r->config, r->path);
    fclose(out);
    cfg *config = cfg_load(file, stderr);
    assert_non_null(config);
    unlink(file);
    return config;
}

static inline int set_up_with(void **state, const char *config)
{
    rig *r = calloc(1, sizeof *r);
    r->config = config;
    strcpy(r->folder, "/tmp/test_control.XXXXXX");
    assert_non_null(mkdtemp(r->folder));
    snprintf(r->path, sizeof r->path, "%s/bus.sock", r->folder);
    r->loop = ev_loop_new(0);
    r->live = live_new(load(r));
    uint16_t more = (uint16_t)(CW_RULES_MAX - live_config(r->live)->rule_count);
    assert_true(fake_engine_make(&r->engine, r->live, more, UPDATE_BITS));
    r->control = control_start(r->loop, r->live, &r->engine, &r->errors, -1);
    assert_non_null(r->control);
    control_on_reload(r->control, fake_engine_ask, &r->engine);
    engine_observe(&r->engine, control_event, r->control);
    *state = r;
    return 0;
}

static inline int set_up(void **state)
{
    return set_up_with(state, config_text);
}

static inline int tear_down(void **state)
{
    rig *r = *state;
    control_stop(r->control);
    live_free(r->live);
    free(r->engine.memory);
    ev_loop_destroy(r->loop);
    assert_int_equal(access(r->path, F_OK), -1); /* the socket went with the server */
    assert_int_equal(rmdir(r->folder), 0);
    free(r);
    return 0;
}

static inline void turn(const rig *r)
{
    ev_run(r->loop, EVRUN_NOWAIT);
    if (!r->reloads_take_long)
        fake_engine_answer((engine *)(uintptr_t)&r->engine, r->control);
}

static inline void turns(const rig *r, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        turn(r);
}

/* ---- Clients --------------------------------------------------------------------------------- */

/* Connects; returns -1 when the server's queue is full. */
static inline int try_to_connect(const rig *r)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    strcpy(address.sun_path, r->path);
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    assert_true(fd >= 0);
    if (connect(fd, (struct sockaddr *)&address, sizeof address) == 0)
        return fd;
    close(fd);
    return -1;
}

static inline int connect_client(const rig *r)
{
    int fd = try_to_connect(r);
    assert_true(fd >= 0);
    return fd;
}

/* Sends all of it while the server works; false when it hangs up. */
static inline bool send_bytes(const rig *r, int fd, const char *bytes, size_t length)
{
    size_t sent = 0;
    for (unsigned i = 0; sent < length && i < PATIENCE_TURNS; i++) {
        ssize_t count = send(fd, bytes + sent, length - sent, MSG_NOSIGNAL);
        if (count < 0 && errno != EAGAIN)
            return false;
        sent += count > 0 ? (size_t)count : 0;
        turn(r);
    }
    assert_int_equal(sent, length);
    return true;
}

static inline void send_text(const rig *r, int fd, const char *text)
{
    assert_true(send_bytes(r, fd, text, strlen(text)));
}

/* Returns the next line, without its end; NULL when the server has hung up. It reads byte by byte,
 * so that no byte behind the line is taken. */
static inline const char *next_line(const rig *r, int fd)
{
    static char line[1u << 20];
    size_t length = 0;
    for (unsigned i = 0; i < PATIENCE_TURNS;) {
        ssize_t count = recv(fd, line + length, 1, 0);
        if (count == 0 || (count < 0 && errno != EAGAIN))
            return NULL;
        if (count < 0) {
            turn(r);
            i++;
        } else if (line[length++] == '\n') {
            line[length - 1] = '\0';
            return line;
        }
        assert_true(length < sizeof line);
    }
    fail_msg("no line came");
    return NULL;
}

static inline json_t *next_json(const rig *r, int fd)
{
    const char *line = next_line(r, fd);
    assert_non_null(line);
    json_t *value = json_loads(line, JSON_REJECT_DUPLICATES, NULL);
    if (!value)
        fail_msg("no JSON: %s", line);
    return value;
}

static inline json_t *ask(const rig *r, int fd, const char *request)
{
    send_text(r, fd, request);
    send_text(r, fd, "\n");
    return next_json(r, fd);
}

static inline const char *text(const json_t *object, const char *key)
{
    return json_string_value(json_object_get(object, key));
}

static inline json_int_t number(const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);
    if (!json_is_integer(value))
        fail_msg("no number: %s", key);
    return json_integer_value(value);
}

static inline bool is_on(const json_t *object, const char *key)
{
    return json_is_true(json_object_get(object, key));
}

/* Asks what must be granted. */
static inline json_t *grant(const rig *r, int fd, const char *request)
{
    json_t *reply = ask(r, fd, request);
    if (!is_on(reply, "ok"))
        fail_msg("%s: %s", request, text(reply, "error"));
    return reply;
}

static inline void tell(const rig *r, int fd, const char *request)
{
    json_decref(grant(r, fd, request));
}

/* ---- Places ---------------------------------------------------------------------------------- */

#define CASE(test) TEST_WITH(test, set_up, tear_down)

#endif
