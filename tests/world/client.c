/* SPDX-License-Identifier: MIT
 *
 * client.c - clients of the control socket: one that watches, one that asks and expects answers,
 * some that are hostile or idle.
 */
#include "world.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define SOCKET "run/w.sock"
#define ANSWER_NS (2 * S) /* at the latest: more than two of the longest turns (TURN_MAX_NS) */
#define ASK_NS (40 * MS)
#define IDLERS 12u
#define LINE_MAX_BYTES 4096u

typedef struct text {
    char *bytes;
    size_t size;
} text;

typedef struct client {
    actor actor;
    int fd;
    int connection;
    int life;
    int64_t asked_ns; /* NEVER: nothing is open */
    bool is_status;   /* asked for when all was quiet */
    uint64_t before[ECUS_MAX];
    char request[LINE_MAX_BYTES];
    text in;
} client;

static client watcher, asker, hostile;
static int idlers[IDLERS];
static text watched[LIVES_MAX];
static quiet_status statuses[LIVES_MAX];
static bool quiet;

static void add(text *t, const char *bytes, size_t size)
{
    t->bytes = realloc(t->bytes, t->size + size + 1);
    memcpy(t->bytes + t->size, bytes, size);
    t->size += size;
    t->bytes[t->size] = '\0';
}

static bool open_client(client *c)
{
    if (!manager_is_up())
        return false;
    c->connection = world_connect(SOCKET, SOCK_STREAM, 0, &c->fd);
    c->life = life_now();
    c->asked_ns = NEVER;
    c->in.size = 0;
    return c->connection >= 0;
}

static void close_client(client *c)
{
    (void)close(c->fd);
    c->fd = -1;
    c->asked_ns = NEVER;
    world_wake_all_fds();
}

static void ask(client *c, const char *line)
{
    size_t size = strlen(line);
    if (send(c->fd, line, size, MSG_DONTWAIT | MSG_NOSIGNAL) != (ssize_t)size)
        return;
    c->asked_ns = world->now_ns;
    c->is_status = quiet && strstr(line, "\"status\"") != NULL;
    if (c->is_status)
        ecus_count(c->before, c->life);
    (void)snprintf(c->request, sizeof c->request, "%.200s", line);
    world_trace("asks %.200s", line);
    world_wake_all_fds();
}

/* ---- Watching -------------------------------------------------------------------------------- */

/* Returns true when the other end has gone. */
static bool read_into(client *c, text *t)
{
    char piece[65536];
    ssize_t count;
    while ((count = recv(c->fd, piece, sizeof piece, MSG_DONTWAIT)) > 0)
        add(t, piece, (size_t)count);
    return count == 0 || (errno != EAGAIN && errno != EINTR);
}

/* Forgets the rest of a broken connection. */
static void forget_half_line(text *t)
{
    while (t->size > 0 && t->bytes[t->size - 1] != '\n')
        t->bytes[--t->size] = '\0';
}

static void watch(actor *self)
{
    client *c = (client *)self;
    self->next_ns = world->now_ns + 5 * MS;
    if (c->fd < 0 && open_client(c)) {
        forget_half_line(&watched[c->life]);
        ask(c, "{\"request\":\"watch\"}\n");
    }
    if (c->fd >= 0 && read_into(c, &watched[c->life]))
        close_client(c);
}

const char *client_watched(int life, size_t *size)
{
    *size = watched[life].size;
    return watched[life].bytes;
}

/* ---- Asking ---------------------------------------------------------------------------------- */

static const char *const requests[] = {
    "{\"request\":\"status\"}\n",
    "{\"request\":\"status\"}\n",
    "{\"request\":\"status\"}\n",
    "{\"request\":\"faults\"}\n",
    "{\"request\":\"inject\",\"name\":\"x\",\"text\":\"{ name: one, do: { send: \\\"5F0#AA\\\", "
    "as: load } }\"}\n",
    "{\"request\":\"inject\",\"text\":\"{ name: two, when: { every: 5 }, do: { flip: "
    "\\\"data[0.1]\\\" } }\"}\n",
    "{\"request\":\"inject\",\"text\":\"{ bad: \"}\n",
    "{\"request\":\"clear\"}\n",
    "{\"request\":\"clear\",\"injected\":true}\n",
    "{\"request\":\"fire\",\"rule\":\"none\"}\n",
    "{\"request\":\"restart\",\"node\":\"e0\"}\n",
    "{\"request\":\"set\",\"node\":\"e1\",\"settings\":{\"one-shot\":true}}\n",
    "{\"request\":\"set\",\"node\":\"e1\",\"settings\":{\"one-shot\":false}}\n",
};

static const char *next_request(void)
{
    const unsigned count = sizeof requests / sizeof requests[0];
    if (quiet)
        return requests[0];
    if (the_story.reloads && world_chance(60))
        return "{\"request\":\"reload\"}\n";
    return requests[world_draw(the_story.faults ? count : 3)];
}

static void take_answer(client *c)
{
    char *end = c->in.size ? memchr(c->in.bytes, '\n', c->in.size) : NULL;
    if (!end)
        return;
    *end = '\0';
    world_trace("answer after %lld us: %.100s", (long long)((world->now_ns - c->asked_ns) / US),
                c->in.bytes);
    if (c->is_status && strncmp(c->in.bytes, "{\"ok\":true", 10) == 0) {
        quiet_status *s = &statuses[c->life];
        free(s->text);
        s->text = strdup(c->in.bytes);
        memcpy(s->before, c->before, sizeof s->before);
        ecus_count(s->after, c->life);
    }
    c->in.size = 0;
    c->asked_ns = NEVER;
}

/* Checks the time of an answer; a machine that stands still answers nothing. */
static void check_answer(client *c)
{
    const world_life *l = &world->lives[c->life];
    if (l->stopped_until_ns > c->asked_ns)
        c->asked_ns = l->stopped_until_ns;
    if (l->alive && l->stop_ns == NEVER && world->now_ns > c->asked_ns + ANSWER_NS)
        verdict("no answer within %d ms to %.*s", (int)(ANSWER_NS / MS),
                (int)strcspn(c->request, "\n"), c->request);
}

static void ask_on(actor *self)
{
    client *c = (client *)self;
    self->next_ns = world->now_ns + 2 * MS;
    if (c->fd < 0 && !open_client(c))
        return;
    bool gone = read_into(c, &c->in);
    if (c->asked_ns != NEVER)
        take_answer(c);
    if (gone) {
        close_client(c);
    } else if (c->asked_ns != NEVER) {
        check_answer(c);
    } else {
        ask(c, next_request());
        self->next_ns = world->now_ns + (int64_t)world_draw(2 * ASK_NS);
    }
}

const quiet_status *client_last_status(int life)
{
    return &statuses[life];
}

/* ---- Trouble --------------------------------------------------------------------------------- */

static void send_garbage(int fd)
{
    static const char *const pieces[] = {
        "{\"request\":\"sta",        "tus\"}",     "\n", "[[[[[[[[",   "\n\n\n",
        "{\"request\":\"watch\"}\n", "\xff\xfe\n", "}{", "{\"a\":1}\n"};
    for (unsigned i = (unsigned)world_draw(20); i > 0; i--) {
        const char *piece = pieces[world_draw(sizeof pieces / sizeof pieces[0])];
        (void)!send(fd, piece, strlen(piece), MSG_DONTWAIT | MSG_NOSIGNAL);
    }
}

static void trouble(actor *self)
{
    client *c = (client *)self;
    self->next_ns = world->now_ns + (int64_t)world_draw(100 * MS);
    if (quiet || !manager_is_up())
        return;
    if (c->fd < 0 && !open_client(c))
        return;
    send_garbage(c->fd);
    world_trace("a hostile client has sent garbage");
    world_wake_all_fds();
    if (world_chance(300))
        close_client(c);
}

static void idle(actor *self)
{
    self->next_ns = world->now_ns + 50 * MS;
    for (unsigned i = 0; i < IDLERS && manager_is_up(); i++) {
        char byte;
        if (idlers[i] >= 0 && recv(idlers[i], &byte, 1, MSG_DONTWAIT) == 0) {
            (void)close(idlers[i]);
            idlers[i] = -1;
        }
        if (idlers[i] < 0 && world_chance(100))
            (void)world_connect(SOCKET, SOCK_STREAM, 1000 + i % 3, &idlers[i]);
    }
}

static actor idler;

void clients_quiet(void)
{
    quiet = true;
}

void clients_drain(void)
{
    if (watcher.fd >= 0 && read_into(&watcher, &watched[watcher.life]))
        close_client(&watcher);
}

static void begin(client *c, bool wanted, void (*act)(actor *))
{
    if (c->actor.act && c->fd >= 0)
        (void)close(c->fd);
    free(c->in.bytes);
    *c = (client){.fd = -1, .asked_ns = NEVER};
    c->actor = (actor){.next_ns = world->now_ns + (int64_t)world_draw(20 * MS), .act = act};
    if (wanted)
        world_add_actor(&c->actor);
}

void clients_add(void)
{
    static bool before;
    quiet = false;
    for (unsigned i = 0; i < LIVES_MAX; i++) {
        free(watched[i].bytes);
        free(statuses[i].text);
        watched[i] = (text){.size = 0};
        statuses[i] = (quiet_status){.text = NULL};
    }
    for (unsigned i = 0; i < IDLERS; i++) {
        if (before && idlers[i] >= 0)
            (void)close(idlers[i]);
        idlers[i] = -1;
    }
    before = true;
    begin(&watcher, the_story.watch, watch);
    begin(&asker, true, ask_on);
    begin(&hostile, the_story.hostile, trouble);
    idler = (actor){.next_ns = world->now_ns, .act = idle};
    if (the_story.idlers)
        world_add_actor(&idler);
}
