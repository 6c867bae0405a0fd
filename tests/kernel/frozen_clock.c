/* SPDX-License-Identifier: MIT
 *
 * frozen_clock.c - to be preloaded. While the file $FROZEN exists, the monotonic clock stands still
 * for the program itself. It goes on for its libraries, including the event loop.
 */
#include <dlfcn.h>
#include <stdlib.h>
#include <sys/auxv.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static const void *object_of(const void *address)
{
    Dl_info info;
    return dladdr(address, &info) ? info.dli_fbase : NULL;
}

int clock_gettime(clockid_t clock, struct timespec *now)
{
    static struct timespec seen;
    const void *program = object_of((const void *)getauxval(AT_PHDR));
    if (clock != CLOCK_MONOTONIC || object_of(__builtin_return_address(0)) != program)
        return (int)syscall(SYS_clock_gettime, clock, now);
    if (seen.tv_sec == 0 || access(getenv("FROZEN"), F_OK) != 0)
        (void)syscall(SYS_clock_gettime, clock, &seen);
    *now = seen;
    return 0;
}
