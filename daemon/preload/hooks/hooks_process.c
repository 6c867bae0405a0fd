/* SPDX-License-Identifier: MIT
 *
 * hooks_process.c - calls that wait for children, and that make threads.
 */
#include "preload/hooks/hook.h"
#include "preload/vtime.h"

#include <stdlib.h>
#include <unistd.h>

/* ---- Children -------------------------------------------------------------------------------- */

HOOK pid_t wait4(pid_t pid, int *status, int options, struct rusage *usage)
{
    if (!vtime_is_on())
        return real()->wait4(pid, status, options, usage);
    pid_t found = real()->wait4(pid, status, options | WNOHANG, usage);
    if (found == 0 && (options & WNOHANG))
        vtime_look();
    if (found != 0 || (options & WNOHANG))
        return found;
    vtime_leave_to_children();
    found = real()->wait4(pid, status, options, usage);
    vtime_come_back();
    return found;
}

HOOK pid_t waitpid(pid_t pid, int *status, int options)
{
    return wait4(pid, status, options, NULL);
}

HOOK pid_t wait3(int *status, int options, struct rusage *usage)
{
    return wait4(-1, status, options, usage);
}

HOOK pid_t wait(int *status)
{
    return wait4(-1, status, 0, NULL);
}

HOOK int waitid(idtype_t type, id_t id, siginfo_t *info, int options)
{
    if (!vtime_is_on() || (options & WNOHANG))
        return real()->waitid(type, id, info, options);
    vtime_leave_to_children();
    const int result = real()->waitid(type, id, info, options);
    vtime_come_back();
    return result;
}

HOOK int system(const char *command)
{
    if (!command || !vtime_is_on())
        return real()->system(command);
    vtime_leave_to_children();
    const int result = real()->system(command);
    vtime_come_back();
    return result;
}

HOOK int pclose(FILE *pipe)
{
    if (!vtime_is_on())
        return real()->pclose(pipe);
    vtime_leave_to_children();
    const int result = real()->pclose(pipe);
    vtime_come_back();
    return result;
}

/* ---- Threads --------------------------------------------------------------------------------- */

HOOK int pthread_create(pthread_t *restrict thread, const pthread_attr_t *restrict attributes,
                        void *(*run)(void *), void *restrict argument)
{
    static bool told;
    if (!vtime_is_on())
        return real()->pthread_create(thread, attributes, run, argument);
    if (!told)
        (void)fprintf(stderr, "libcanwire-socketcan: virtual time: the program makes a thread, and "
                              "only programs of one thread have virtual time (canwire-run(7))\n");
    told = true;
    return EAGAIN;
}
