/* SPDX-License-Identifier: MIT
 *
 * pump.c - a thread of the library, for what happens while the program makes no call.
 */
#include "preload/pump.h"

#include "base/moment.h"
#include "preload/hooks/real.h"
#include "preload/table.h"
#include "preload/vtime.h"

#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

#define NS_PER_S INT64_C(1000000000)

static pump_item *items;
static bool runs;
static int wake = -1;

/* Returns CLOCK_MONOTONIC as the program sees it. */
int64_t pump_now_ns(void)
{
    struct timespec now;
    if (vtime_is_on())
        return vtime_on(CLOCK_MONOTONIC, vtime_now_ns());
    (void)real()->clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * NS_PER_S + now.tv_nsec;
}

/* Fills the list of descriptors; the first one wakes the thread. Returns its length. */
static nfds_t list(struct pollfd *fds, nfds_t room, int64_t *due_ns)
{
    nfds_t count = 0;
    fds[count++] = (struct pollfd){.fd = wake, .events = POLLIN};
    *due_ns = PUMP_NEVER;
    for (const pump_item *i = items; i && count < room; i = i->next) {
        fds[count++] = (struct pollfd){.fd = i->fd, .events = POLLIN};
        if (i->due_ns < *due_ns)
            *due_ns = i->due_ns;
    }
    return count;
}

/* Counts the items, and the descriptor that wakes the thread. */
static nfds_t count_items(void)
{
    nfds_t count = 1;
    for (const pump_item *i = items; i; i = i->next)
        count++;
    return count;
}

/* Waits without the lock. Items that are readable are marked. */
static void wait_for_items(struct pollfd *fds, nfds_t count, int64_t due_ns)
{
    struct timespec left = {0};
    uint64_t number;
    const int64_t left_ns = due_ns == PUMP_NEVER ? 0 : due_ns - pump_now_ns();
    if (left_ns > 0)
        left = moment_of(left_ns);
    table_unlock();
    const int found = real()->ppoll(fds, count, due_ns == PUMP_NEVER ? NULL : &left, NULL);
    table_lock();
    if (found <= 0)
        return;
    if (fds[0].revents)
        (void)!real()->read(wake, &number, sizeof number);
    for (pump_item *i = items; i; i = i->next)
        for (nfds_t k = 1; i->fd >= 0 && k < count; k++)
            if (fds[k].fd == i->fd && fds[k].revents)
                i->ready = true;
}

/* Runs an item that is ready or due. Returns false when there is none. */
static bool run_one(int64_t now_ns)
{
    for (pump_item *i = items; i; i = i->next) {
        const bool readable = i->ready;
        if (!readable && i->due_ns > now_ns)
            continue;
        i->ready = false;
        i->run(i, readable); /* the list may be another one now */
        return true;
    }
    return false;
}

/* Waits for items, at most until a time, and runs those that are ready or due. */
static void run_items(int64_t until_ns)
{
    int64_t due_ns = PUMP_NEVER;
    const nfds_t room = count_items();
    struct pollfd *fds = calloc(room, sizeof *fds);
    const nfds_t count = fds ? list(fds, room, &due_ns) : 0;
    if (fds)
        wait_for_items(fds, count, due_ns < until_ns ? due_ns : until_ns);
    free(fds);
    const int64_t now_ns = pump_now_ns();
    for (nfds_t k = 0; k < 2 * room && run_one(now_ns); k++)
        continue;
}

/* The thread. It holds the lock, except while it waits. */
static void *pump(void *nothing)
{
    (void)nothing;
    table_lock();
    for (;;)
        run_items(PUMP_NEVER);
    return NULL;
}

/* ---- Virtual time ---------------------------------------------------------------------------- */

bool pump_has_items(void)
{
    return items != NULL;
}

int64_t pump_due_ns(void)
{
    int64_t due_ns = PUMP_NEVER;
    for (const pump_item *i = items; i; i = i->next)
        if (i->due_ns < due_ns)
            due_ns = i->due_ns;
    return due_ns == PUMP_NEVER ? VTIME_NEVER : vtime_of(CLOCK_MONOTONIC, due_ns);
}

void pump_step(void)
{
    if (!items)
        return;
    table_lock();
    run_items(0);
    table_unlock();
}

/* ---- The thread ------------------------------------------------------------------------------ */

/* Starts the thread. It takes no signals, which are the program's. */
static void pump_start(void)
{
    pthread_t thread;
    pthread_attr_t attributes;
    sigset_t all, before;
    if (runs || vtime_is_on())
        return;
    if (wake < 0)
        wake = table_hide(eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK));
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &before);
    (void)pthread_attr_init(&attributes);
    (void)pthread_attr_setdetachstate(&attributes, PTHREAD_CREATE_DETACHED);
    runs = real()->pthread_create(&thread, &attributes, pump, NULL) == 0;
    (void)pthread_attr_destroy(&attributes);
    (void)pthread_sigmask(SIG_SETMASK, &before, NULL);
}

void pump_put(pump_item *item)
{
    const uint64_t one = 1;
    if (!item->in_list) {
        item->next = items;
        item->in_list = true;
        items = item;
    }
    pump_start();
    if (wake >= 0)
        (void)!real()->write(wake, &one, sizeof one);
}

/* May be called for an item that is not in the list. */
void pump_remove(pump_item *item)
{
    for (pump_item **i = &items; *i; i = &(*i)->next)
        if (*i == item) {
            *i = item->next;
            break;
        }
    item->in_list = false;
    item->ready = false;
}

void pump_forked(void)
{
    runs = false;
    table_close_hidden(wake);
    wake = -1;
    if (items)
        pump_start();
}
