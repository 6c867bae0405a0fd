/* SPDX-License-Identifier: MIT
 *
 * hooks_descriptor.c - calls that copy and close descriptors, and that end the process.
 */
#include "preload/create.h"
#include "preload/hooks/hook.h"
#include "preload/vtimer.h"

#include <fcntl.h>
#include <linux/close_range.h>
#include <stdarg.h>
#include <stdlib.h>
#include <unistd.h>

HOOK int close(int fd)
{
    vtimer_forget(fd);
    if (!table_concerns(fd))
        return real()->close(fd);
    if (table_is_hidden(fd))
        return hook_result(EBADF);
    create_close(fd);
    return real()->close(fd);
}

/* Closes a range but for hidden descriptors, of which each ends a part. */
static int close_parts(unsigned first, unsigned last, int flags)
{
    unsigned part = first;
    const unsigned end = last < TABLE_MAX ? last + 1 : TABLE_MAX;
    for (unsigned fd = first; fd < end; fd++) {
        if (table_concerns((int)fd) && !table_is_hidden((int)fd))
            create_close((int)fd);
        if (!table_is_hidden((int)fd))
            continue;
        if (fd > part && real()->close_range(part, fd - 1, flags) != 0)
            return -1;
        part = fd + 1;
    }
    return part <= last ? real()->close_range(part, last, flags) : 0;
}

HOOK int close_range(unsigned first, unsigned last, int flags)
{
    if (!real()->close_range)
        return hook_result(ENOSYS);
    if (((unsigned)flags & CLOSE_RANGE_CLOEXEC) || first > last || !table_is_own_process())
        return real()->close_range(first, last, flags);
    return close_parts(first, last, flags);
}

HOOK void closefrom(int first)
{
    if (!table_is_own_process() || !real()->close_range)
        real()->closefrom(first);
    else
        (void)close_parts(first > 0 ? (unsigned)first : 0, ~0u, 0);
}

/* ---- Copies ---------------------------------------------------------------------------------- */

/* Notes that a descriptor is a copy. */
static int note_copy(int copy, int fd)
{
    cansock *s = copy >= 0 && table_concerns(fd) ? table_take(fd) : NULL;
    if (!s)
        return copy;
    table_add(copy, s);
    table_give(s);
    return copy;
}

HOOK int dup(int fd)
{
    return note_copy(real()->dup(fd), fd);
}

/* Gives up the place of a copy. Returns false when the program cannot have it. */
static bool vacate(int fd, int to)
{
    if (fd == to || !table_concerns(to) || real()->fcntl(fd, F_GETFD) < 0)
        return true;
    if (table_is_hidden(to))
        return false;
    create_close(to);
    return true;
}

HOOK int dup2(int fd, int to)
{
    if (!vacate(fd, to))
        return hook_result(EBUSY);
    const int copy = real()->dup2(fd, to);
    return fd == to ? copy : note_copy(copy, fd);
}

HOOK int dup3(int fd, int to, int flags)
{
    if (!vacate(fd, to))
        return hook_result(EBUSY);
    return note_copy(real()->dup3(fd, to, flags), fd);
}

static bool copies(int command)
{
    return command == F_DUPFD || command == F_DUPFD_CLOEXEC;
}

HOOK int fcntl(int fd, int command, ...)
{
    va_list more;
    va_start(more, command);
    void *argument = va_arg(more, void *);
    va_end(more);
    const int result = real()->fcntl(fd, command, argument);
    return copies(command) ? note_copy(result, fd) : result;
}

int fcntl64(int fd, int command, ...);

HOOK int fcntl64(int fd, int command, ...)
{
    va_list more;
    va_start(more, command);
    void *argument = va_arg(more, void *);
    va_end(more);
    int (*call)(int, int, ...) = real()->fcntl64 ? real()->fcntl64 : real()->fcntl;
    const int result = call(fd, command, argument);
    return copies(command) ? note_copy(result, fd) : result;
}

/* ---- The end of the process ------------------------------------------------------------------ */

HOOK void _exit(int status)
{
    create_exit();
    real()->_exit(status);
    abort();
}

HOOK void _Exit(int status)
{
    create_exit();
    real()->_Exit(status);
    abort();
}
