/* SPDX-License-Identifier: MIT
 *
 * signal_at_wait.c - to be preloaded into a program in virtual time that handles SIGUSR1. It comes
 * when the program's turn has ended, before it waits.
 */
#include "port/timing.h"

#include <dlfcn.h>
#include <signal.h>
#include <sys/socket.h>

ssize_t send(int fd, const void *what, size_t size, int flags)
{
    ssize_t (*real)(int, const void *, size_t, int) =
        (ssize_t(*)(int, const void *, size_t, int))dlsym(RTLD_NEXT, "send");
    struct sigaction handler = {.sa_handler = SIG_DFL};
    const ssize_t sent = real(fd, what, size, flags);
    (void)sigaction(SIGUSR1, NULL, &handler);
    if (handler.sa_handler != SIG_DFL && size == sizeof(message_head) &&
        ((const message_head *)what)->type == TIMING_WAIT)
        (void)raise(SIGUSR1);
    return sent;
}
