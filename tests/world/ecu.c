/* SPDX-License-Identifier: MIT
 *
 * ecu.c - ECUs at `unix:` ports: they send frames with numbers, read or do not, go and come.
 */
#include "world.h"

#include <errno.h>
#include <linux/can.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define LINE_BYTES 64u

typedef struct ecu {
    actor actor;
    unsigned number;
    int fd; /* -1: not connected */
    int connection;
    int life;
    uint32_t sequence;
    int64_t period_ns;
    unsigned burst;
    bool quiet;
    int64_t deaf_until_ns;
    ecu_seen seen[LIVES_MAX];
} ecu;

static ecu ecus[ECUS_MAX];

int world_connect(const char *path, int type, unsigned uid, int *fd)
{
    struct sockaddr_un own = {.sun_family = AF_UNIX}, other = {.sun_family = AF_UNIX};
    if (world->connection_count == CONNECTIONS_MAX)
        return -1;
    int number = (int)world->connection_count;
    (void)snprintf(own.sun_path, sizeof own.sun_path, "c/%d", number);
    (void)snprintf(other.sun_path, sizeof other.sun_path, "%s", path);
    *fd = socket(AF_UNIX, type | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (bind(*fd, (const struct sockaddr *)&own, sizeof own) != 0)
        abort();
    world->connection_count++;
    if (connect(*fd, (const struct sockaddr *)&other, sizeof other) != 0) {
        (void)close(*fd);
        *fd = -1;
        return -1;
    }
    world->connections[number] = (world_connection){.uid = uid};
    world_trace("connection %d to %s", number, path);
    world_wake_all_fds();
    return number;
}

void world_sent(int connection)
{
    world_connection *c = &world->connections[connection];
    c->stamps[c->sent++ % STAMPS_MAX] = world->now_ns;
}

/* ---- Frames ---------------------------------------------------------------------------------- */

static void note(ecu *e, const struct can_frame *frame)
{
    ecu_seen *s = &e->seen[e->life];
    char line[LINE_BYTES];
    int used = snprintf(line, sizeof line, "%03X#", frame->can_id & CAN_EFF_MASK);
    for (unsigned i = 0; i < frame->len && i < CAN_MAX_DLEN; i++)
        used += snprintf(line + used, sizeof line - (size_t)used, "%02X", frame->data[i]);
    line[used++] = '\n';
    s->text = realloc(s->text, s->size + (size_t)used + 1);
    memcpy(s->text + s->size, line, (size_t)used + 1);
    s->size += (size_t)used;
    s->text[s->size] = '\0';
    s->frames++;
}

static void hang_up(ecu *e, const char *why)
{
    world_trace("ECU %u %s", e->number, why);
    (void)close(e->fd);
    e->fd = -1;
    e->seen[e->life].steady = false;
    world_wake_all_fds();
}

static void read_frames(ecu *e)
{
    struct can_frame frame;
    ssize_t size = 0;
    while (e->fd >= 0) {
        size = recv(e->fd, &frame, sizeof frame, MSG_DONTWAIT);
        if (size < 0 && errno == ECONNRESET)
            continue; /* reported once, before the rest */
        if (size <= 0)
            break;
        e->seen[e->life].received++;
        if (!(frame.can_id & CAN_ERR_FLAG))
            note(e, &frame);
    }
    bool gone = size == 0 || (size < 0 && errno != EAGAIN);
    if (e->fd >= 0 && gone) {
        bool steady = e->seen[e->life].steady;
        hang_up(e, "sees the end");
        e->seen[e->life].steady = steady;
    }
}

static void send_frame(ecu *e)
{
    uint32_t n = e->sequence;
    struct can_frame frame = {.can_id = 0x100 + 0x100 * e->number + (canid_t)world_draw(4),
                              .len = 8};
    frame.data[0] = (uint8_t)(e->number + 1);
    frame.data[1] = (uint8_t)e->life;
    memcpy(frame.data + 4,
           (const uint8_t[]){(uint8_t)(n >> 24), (uint8_t)(n >> 16), (uint8_t)(n >> 8), (uint8_t)n},
           4);
    if (send(e->fd, &frame, sizeof frame, MSG_DONTWAIT | MSG_NOSIGNAL) != sizeof frame)
        return;
    world_sent(e->connection);
    e->sequence++;
    e->seen[e->life].sent++;
}

static void send_burst(ecu *e)
{
    unsigned count = 1 + (unsigned)world_draw(e->burst);
    for (unsigned i = 0; i < count && e->fd >= 0; i++)
        send_frame(e);
    world_trace("ECU %u has sent %llu", e->number, (unsigned long long)e->seen[e->life].sent);
    world_wake_all_fds();
}

/* ---- Acting ---------------------------------------------------------------------------------- */

static void connect_ecu(ecu *e)
{
    char path[32];
    if (!manager_is_up())
        return;
    (void)snprintf(path, sizeof path, "run/e%u.sock", e->number);
    e->connection = world_connect(path, SOCK_SEQPACKET, 0, &e->fd);
    if (e->connection < 0)
        return;
    e->life = life_now();
    if (e->seen[e->life].text == NULL && e->seen[e->life].sent == 0)
        e->seen[e->life] = (ecu_seen){.life = e->life, .steady = true};
}

static void act(actor *self)
{
    ecu *e = (ecu *)self;
    self->next_ns = world->now_ns + e->period_ns / 2 + (int64_t)world_draw((uint64_t)e->period_ns);
    if (e->fd < 0)
        connect_ecu(e);
    if (e->fd < 0)
        return;
    if (the_story.deaf_ecus && !e->quiet && world_chance(20))
        e->deaf_until_ns = world->now_ns + (int64_t)world_draw(500 * MS);
    if (world->now_ns >= e->deaf_until_ns)
        read_frames(e);
    if (e->fd >= 0 && !e->quiet)
        send_burst(e);
    if (e->fd >= 0 && the_story.vanishing && !e->quiet && world_chance(30))
        hang_up(e, "goes");
}

void ecus_quiet(void)
{
    for (unsigned i = 0; i < the_story.ecus; i++) {
        ecus[i].quiet = true;
        ecus[i].deaf_until_ns = 0;
        ecus[i].period_ns = 5 * MS;
    }
}

void ecus_drain(void)
{
    for (unsigned i = 0; i < the_story.ecus; i++)
        if (ecus[i].fd >= 0)
            read_frames(&ecus[i]);
}

void ecus_count(uint64_t frames[ECUS_MAX], int life)
{
    ecus_drain();
    for (unsigned i = 0; i < the_story.ecus; i++)
        frames[i] = ecus[i].seen[life].frames;
}

const ecu_seen *ecu_seen_of(unsigned number, int life)
{
    return &ecus[number].seen[life];
}

static void forget(ecu *e)
{
    if (e->actor.act && e->fd >= 0)
        (void)close(e->fd);
    for (unsigned i = 0; i < LIVES_MAX; i++)
        free(e->seen[i].text);
    memset(e, 0, sizeof *e);
}

void ecus_add(void)
{
    for (unsigned i = 0; i < ECUS_MAX; i++)
        forget(&ecus[i]);
    for (unsigned i = 0; i < the_story.ecus; i++) {
        ecu *e = &ecus[i];
        e->number = i;
        e->fd = -1;
        e->period_ns = world_between(1 * MS, 30 * MS);
        e->burst = (unsigned)world_between(1, 20);
        e->actor = (actor){.next_ns = world->now_ns + (int64_t)world_draw(20 * MS), .act = act};
        world_add_actor(&e->actor);
    }
}
