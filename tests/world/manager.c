/* SPDX-License-Identifier: MIT
 *
 * manager.c - the service manager. It starts canwired, and again after a failure. It reads the
 * messages of canwired about its state, and does not wait for ever for its end.
 */
#include "world.h"

#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define LOOK_NS (10 * MS)
#define RESTART_NS (200 * MS) /* RestartSec */
#define WATCHDOG_NS (10 * S)  /* WatchdogSec */
#define STOP_NS (10 * S)      /* TimeoutStopSec */
#define START_NS (30 * S)     /* TimeoutStartSec */
#define LOOP_CRASHES 4u
#define LOOP_CALLS 20000

typedef struct notice {
    int fd;
    int64_t alive_ns;
} notice;

static struct {
    actor actor;
    int64_t start_ns; /* the next one; NEVER */
    bool closing;
    unsigned crashes;
    unsigned twins_left;
    notice notices[LIVES_MAX];
} m;

static void open_notice(int life)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    notice *n = &m.notices[life];
    (void)snprintf(address.sun_path, sizeof address.sun_path, "run/notify.%d", life);
    n->fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    n->alive_ns = world->now_ns;
    if (bind(n->fd, (const struct sockaddr *)&address, sizeof address) != 0)
        abort();
}

static int start_one(void)
{
    open_notice((int)world->life_count);
    return life_start(the_story.journal ? WORLD_ROOT "log/journal" : NULL);
}

static void start(void)
{
    int life = start_one();
    m.start_ns = NEVER;
    if (the_story.twins && m.twins_left > 0) {
        m.twins_left--;
        int twin = start_one();
        world->lives[life].may_fail = true;
        world->lives[twin].may_fail = true;
    }
    if (the_story.restarts && m.crashes < LOOP_CRASHES) {
        m.crashes++;
        world->lives[life].die_at_call = 2000 + (int64_t)world_draw(LOOP_CALLS);
    }
}

/* Checks that no two lives that are ready have the same sockets. */
static void check_alone(int life)
{
    for (int i = 0; i < (int)world->life_count; i++) {
        const world_life *other = &world->lives[i];
        if (i != life && other->alive && other->started_up && other->stop_ns == NEVER)
            verdict("two daemons on one control path: lives %d and %d are both ready", i, life);
    }
}

static void take_notice(int life, const char *text)
{
    world_life *l = &world->lives[life];
    m.notices[life].alive_ns = world->now_ns;
    if (strcmp(text, "READY=1") != 0 || l->ready_ns != NEVER)
        return;
    l->ready_ns = world->now_ns;
    l->journal = the_story.journal ? file_identity("log/journal") : 0;
    if (l->alive)
        check_alone(life);
}

static void read_notices(int life)
{
    char text[2048];
    ssize_t count;
    while ((count = recv(m.notices[life].fd, text, sizeof text - 1, 0)) > 0) {
        text[count] = '\0';
        take_notice(life, text);
    }
}

static const char *where_main_is(int life)
{
    for (unsigned i = 0; i < TASKS_MAX; i++)
        if (world->tasks[i].state != TASK_NONE && world->tasks[i].life == life &&
            world->tasks[i].is_main)
            return world->tasks[i].call;
    return "?";
}

static void check_times(int life)
{
    const world_life *l = &world->lives[life];
    if (world->now_ns < l->stopped_until_ns + S)
        m.notices[life].alive_ns = world->now_ns;
    if (l->stop_ns != NEVER && world->now_ns > l->stop_ns + STOP_NS)
        verdict("SIGTERM does not end life %d within %d s: it is in %s", life, (int)(STOP_NS / S),
                where_main_is(life));
    else if (l->started_up && l->stop_ns == NEVER &&
             world->now_ns > m.notices[life].alive_ns + WATCHDOG_NS)
        verdict("life %d does not feed the watchdog: it is in %s", life, where_main_is(life));
    else if (!l->started_up && l->stop_ns == NEVER && world->now_ns > l->started_ns + START_NS)
        verdict("life %d does not start up: it is in %s", life, where_main_is(life));
}

static void look(actor *self)
{
    bool any = false;
    self->next_ns = world->now_ns + LOOK_NS;
    for (int i = 0; i < (int)world->life_count; i++) {
        read_notices(i);
        life_read_log(i);
        if (!world->lives[i].alive)
            continue;
        any = true;
        check_times(i);
    }
    if (!any && !m.closing && m.start_ns == NEVER)
        m.start_ns = world->life_count == 0 ? world->now_ns : world->now_ns + RESTART_NS;
    if (m.start_ns <= world->now_ns && !m.closing && world->life_count + 2 < LIVES_MAX)
        start();
}

bool manager_is_up(void)
{
    int life = life_now();
    return life >= 0 && world->lives[life].started_up && world->lives[life].stop_ns == NEVER;
}

int manager_stop_all(void)
{
    int count = 0;
    m.closing = true;
    for (int i = 0; i < (int)world->life_count; i++)
        if (world->lives[i].alive) {
            life_signal(i, SIGTERM);
            count++;
        }
    return count;
}

void manager_add(void)
{
    for (unsigned i = 0; i < LIVES_MAX; i++)
        if (m.notices[i].fd > 0)
            (void)close(m.notices[i].fd);
    memset(&m, 0, sizeof m);
    m.start_ns = NEVER;
    m.twins_left = 2;
    m.actor = (actor){.next_ns = world->now_ns, .act = look};
    world_add_actor(&m.actor);
}
