/* SPDX-License-Identifier: MIT
 *
 * watch.c - the epoll sets in which a program has put a CAN socket.
 */
#include "preload/table.h"

#include "preload/hooks/real.h"

#include <stdlib.h>

struct watch {
    watch *next;
    int set;
    int fd;
    struct epoll_event event;
    bool suspended;
};

/* Removes one. */
static void drop(watch **at)
{
    watch *gone = *at;
    *at = gone->next;
    free(gone);
}

static watch **watch_find(watch **first, int set, int fd)
{
    while (*first && ((*first)->set != set || (*first)->fd != fd))
        first = &(*first)->next;
    return first;
}

void watch_note(watch **first, int set, int operation, int fd, const struct epoll_event *event)
{
    watch **at = watch_find(first, set, fd);
    if (operation == EPOLL_CTL_DEL) {
        if (*at)
            drop(at);
        return;
    }
    if (!*at)
        *at = calloc(1, sizeof **at);
    if (!*at)
        return;
    (*at)->set = set;
    (*at)->fd = fd;
    (*at)->event = *event;
}

/* A set that has been closed, or has lost the descriptor, does not get it again. */
void watch_suspend(watch *first, int fd)
{
    for (; first; first = first->next)
        if (first->fd == fd)
            first->suspended = real()->epoll_ctl(first->set, EPOLL_CTL_DEL, fd, NULL) == 0;
}

void watch_resume(watch *first, int fd)
{
    for (; first; first = first->next) {
        if (first->fd != fd || !first->suspended)
            continue;
        first->suspended = false;
        (void)real()->epoll_ctl(first->set, EPOLL_CTL_ADD, fd, &first->event);
    }
}

void watch_forget(watch **first, int fd)
{
    while (*first)
        if ((*first)->fd == fd)
            drop(first);
        else
            first = &(*first)->next;
}
