/* SPDX-License-Identifier: MIT
 *
 * disk.h - waits in unit tests for what another thread writes into a file.
 */
#ifndef CANWIRE_TEST_DISK_H
#define CANWIRE_TEST_DISK_H

#include "cases.h"
#include <limits.h>
#include <poll.h>
#include <sys/inotify.h>
#include <unistd.h>

#define DISK_LOOK_AGAIN_MS 10

/* Sees changes of a file from now on; to be closed. */
static inline int disk_watch(const char *file)
{
    int watch = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
    assert_true(watch >= 0);
    assert_true(inotify_add_watch(watch, file, IN_MODIFY) >= 0);
    return watch;
}

/* Waits for a change since the last call. The thread that makes a change notes it a moment later,
 * without an event. So the call also returns once without a change. */
static inline void disk_wait(int watch)
{
    struct pollfd changed = {.fd = watch, .events = POLLIN};
    char seen[sizeof(struct inotify_event) + NAME_MAX + 1];
    (void)poll(&changed, 1, DISK_LOOK_AGAIN_MS);
    while (read(watch, seen, sizeof seen) > 0)
        continue;
}

#endif
