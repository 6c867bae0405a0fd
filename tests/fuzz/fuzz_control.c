/* SPDX-License-Identifier: MIT
 *
 * fuzz_control.c - what clients write to the control socket, in whatever pieces they write it.
 *
 * Server and clients are in this process, on a real socket; the engine is a fake with a real bus.
 * Input: bytes for the server; those in `marks` are left out and do something else meanwhile.
 */
#include "../unit/fake_engine.h"
#include "fuzz.h"

#include "base/log.h"
#include "serve/control.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define CLIENTS 3u
#define UPDATE_BITS 100u
#define MORE_RULES 32u
#define TURNS_MAX 4000u /* of the loop, until something that must come counts as missing */

/* Bytes that JSON text does not have. */
#define MARK_TURN 0x01u   /* the loop runs once */
#define MARK_NEXT 0x02u   /* the next client goes on */
#define MARK_READ 0x03u   /* the client reads */
#define MARK_FINISH 0x04u /* the client will write no more */
#define MARK_CLOSE 0x05u  /* the client goes, another comes */
#define MARKS_END 0x06u

/* ---- Messages, of which there would be many -------------------------------------------------- */

void log_detail(const char *format, ...)
{
    (void)format;
}

void log_info(const char *format, ...)
{
    (void)format;
}

void log_warning(const char *format, ...)
{
    (void)format;
}

void log_error(const char *format, ...)
{
    (void)format;
}

const char *log_enter(const char *bus)
{
    return bus;
}

/* ---- A bus with a control socket ------------------------------------------------------------- */

typedef struct rig {
    struct sockaddr_un address;
    struct ev_loop *loop;
    live *live;
    engine engine;
    control *control;
    status_errors errors; /* none: nobody counts them */
    int clients[CLIENTS];
    unsigned now; /* the client that writes */
    bool middle;  /* of a reply that is being read; replies are lines of JSON */
} rig;

static char folder[] = "/tmp/fuzz_control.XXXXXX";
static pid_t owner;

static void remove_folder(void)
{
    if (owner == getpid())
        (void)rmdir(folder);
}

static void make_folder(void)
{
    (void)strcpy(folder, "/tmp/fuzz_control.XXXXXX");
    REQUIRE(mkdtemp(folder) != NULL);
    owner = getpid();
    (void)atexit(remove_folder);
}

static cfg *load(const char *socket_path)
{
    char path[32];
    int fd = memfd_create("bus.yaml", MFD_CLOEXEC);
    REQUIRE(fd >= 0);
    (void)dprintf(
        fd,
        "bus: { name: test, bitrate: 500000 }\n"
        "nodes:\n"
        "  - { name: a, warning-limit: 90 }\n"
        "  - { name: b, queue: 4 }\n"
        "  - { name: c, restart-ms: 100 }\n"
        "faults:\n"
        "  - { name: configured, when: { manual: yes }, do: { bus-off: a } }\n"
        "  - { name: traffic, when: { time: 0s }, do: { send: 123#11, as: b, every: 1ms } }\n"
        "control: %s\n",
        socket_path);
    (void)snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    cfg *config = cfg_load(path, stderr);
    REQUIRE(config != NULL);
    (void)close(fd);
    return config;
}

static int connect_client(const rig *r)
{
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    REQUIRE(fd >= 0);
    REQUIRE(connect(fd, (const struct sockaddr *)&r->address, sizeof r->address) == 0);
    return fd;
}

static void start(rig *r)
{
    *r = (rig){.address = {.sun_family = AF_UNIX}, .loop = ev_loop_new(0)};
    (void)snprintf(r->address.sun_path, sizeof r->address.sun_path, "%s/bus.sock", folder);
    r->live = live_new(load(r->address.sun_path));
    REQUIRE(fake_engine_make(&r->engine, r->live, MORE_RULES, UPDATE_BITS));
    r->engine.reload_errors = "bus.yaml:1:1: not now\n";
    r->engine.reload_in_turn = true;
    r->control = control_start(r->loop, r->live, &r->engine, &r->errors, -1);
    REQUIRE(r->control != NULL);
    control_on_reload(r->control, fake_engine_ask, &r->engine);
    engine_observe(&r->engine, control_event, r->control);
    for (unsigned i = 0; i < CLIENTS; i++)
        r->clients[i] = connect_client(r);
}

static void stop(rig *r)
{
    control_stop(r->control);
    REQUIRE(access(r->address.sun_path, F_OK) == -1); /* the socket went with the server */
    live_free(r->live);
    free(r->engine.memory);
    ev_loop_destroy(r->loop);
    for (unsigned i = 0; i < CLIENTS; i++)
        (void)close(r->clients[i]);
}

/* ---- Clients --------------------------------------------------------------------------------- */

static void turn(const rig *r)
{
    (void)ev_run(r->loop, EVRUN_NOWAIT);
    fake_engine_answer((engine *)(uintptr_t)&r->engine, r->control);
}

/* Reads what has come; false when the server has hung up. */
static bool take_replies(int fd)
{
    char bytes[65536];
    ssize_t count;
    while ((count = recv(fd, bytes, sizeof bytes, 0)) > 0)
        REQUIRE(memchr(bytes, '\0', (size_t)count) == NULL);
    return count < 0 && errno == EAGAIN;
}

/* Writes bytes, which the server must take, unless it hangs up. */
static void write_bytes(const rig *r, const uint8_t *bytes, size_t length)
{
    int fd = r->clients[r->now];
    for (unsigned i = 0; length > 0; i++) {
        ssize_t count = send(fd, bytes, length, MSG_NOSIGNAL);
        if (count < 0 && errno != EAGAIN)
            return;
        bytes += count > 0 ? count : 0;
        length -= count > 0 ? (size_t)count : 0;
        if (length > 0)
            turn(r);
        REQUIRE(i < TURNS_MAX);
    }
}

static void obey(rig *r, unsigned mark)
{
    int *fd = &r->clients[r->now];
    if (mark == MARK_TURN)
        turn(r);
    else if (mark == MARK_NEXT)
        r->now = (r->now + 1) % CLIENTS;
    else if (mark == MARK_READ)
        (void)take_replies(*fd);
    else if (mark == MARK_FINISH)
        (void)shutdown(*fd, SHUT_WR);
    else {
        (void)close(*fd);
        turn(r);
        *fd = connect_client(r);
    }
}

static bool is_mark(uint8_t byte)
{
    return byte >= MARK_TURN && byte < MARKS_END;
}

static void write_input(rig *r, const uint8_t *data, size_t size)
{
    for (size_t i = 0; i < size;) {
        size_t piece = 0;
        while (i + piece < size && !is_mark(data[i + piece]))
            piece++;
        write_bytes(r, data + i, piece);
        i += piece;
        if (i < size)
            obey(r, data[i++]);
    }
}

/* Checks that all requests are answered, and that the server hangs up on finished clients. */
static void finish(rig *r)
{
    for (unsigned i = 0; i < CLIENTS; i++)
        (void)shutdown(r->clients[i], SHUT_WR);
    for (unsigned i = 0; i < CLIENTS; i++)
        for (unsigned turns = 0; take_replies(r->clients[i]); turns++) {
            REQUIRE(turns < TURNS_MAX);
            turn(r);
        }
}

/* Checks that a new client is served, whatever others did, and that the bus is in order. */
static void expect_service(rig *r)
{
    static const char request[] = "{\"id\":7,\"request\":\"status\"}\n";
    static const char reply[] = "{\"ok\":true,\"id\":7,";
    char begin[sizeof reply] = "";
    ssize_t count = -1;
    int fd = connect_client(r);
    REQUIRE(send(fd, request, sizeof request - 1, MSG_NOSIGNAL) == (ssize_t)(sizeof request - 1));
    for (unsigned turns = 0; count < 0 && turns < TURNS_MAX; turns++) {
        turn(r);
        count = recv(fd, begin, sizeof begin - 1, 0);
    }
    REQUIRE(count == (ssize_t)(sizeof reply - 1) && strcmp(begin, reply) == 0);
    (void)close(fd);
    turn(r);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    rig r;
    if (owner != getpid())
        make_folder();
    start(&r);
    write_input(&r, data, size);
    finish(&r);
    expect_service(&r);
    stop(&r);
    return 0;
}
