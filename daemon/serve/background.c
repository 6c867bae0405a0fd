/* SPDX-License-Identifier: MIT
 *
 * background.c - canwired in the background: the process that was started ends when its child has
 * a bus that is ready.
 */
#include "serve/start.h"

#include "base/log.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#define FAILED 1

/* Tells why the child has ended before the bus was ready. Its own messages have been printed. */
static int explain(pid_t child)
{
    int status = 0;
    while (waitpid(child, &status, 0) < 0 && errno == EINTR)
        ;
    if (WIFSIGNALED(status))
        log_error("%s (signal %d) before the bus was ready", strsignal(WTERMSIG(status)),
                  WTERMSIG(status));
    return WIFEXITED(status) && WEXITSTATUS(status) != 0 ? WEXITSTATUS(status) : FAILED;
}

static int background_fail(const char *what)
{
    log_error("--background: %s", what);
    return FAILED;
}

/* Prints the number of the bus. Without it nobody could end the bus, so then it ends here. */
static int tell_number(pid_t child)
{
    errno = 0;
    if (printf("%jd\n", (intmax_t)child) > 0 && fflush(stdout) == 0)
        return 0;
    const char *why = strerror(errno);
    (void)kill(child, SIGTERM);
    while (waitpid(child, NULL, 0) < 0 && errno == EINTR)
        ;
    log_error("--background: the number of the process cannot be written: %s", why);
    return FAILED;
}

/* Waits until the child is in service or has ended, and returns the exit status for the shell. */
static int background_await(pid_t child, int fd)
{
    char byte;
    ssize_t count;
    do
        count = read(fd, &byte, 1);
    while (count < 0 && errno == EINTR);
    (void)close(fd);
    if (count != 1)
        return explain(child);
    return tell_number(child);
}

/* The child ends with its parent as long as that waits for it. */
static void follow(pid_t parent)
{
    (void)prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent)
        _exit(FAILED);
}

int background_start(int *ready)
{
    int ends[2];
    const pid_t parent = getpid();
    if (sd_listen_fds(0) > 0)
        return background_fail("the sockets of LISTEN_FDS are for this process alone");
    if (pipe2(ends, O_CLOEXEC) != 0)
        return background_fail(strerror(errno));
    const pid_t child = fork();
    if (child < 0)
        return background_fail(strerror(errno));
    if (child == 0) {
        (void)close(ends[0]);
        follow(parent);
        *ready = ends[1];
        return -1;
    }
    (void)close(ends[1]);
    return background_await(child, ends[0]);
}

void background_ready(int ready)
{
    if (ready < 0)
        return;
    (void)prctl(PR_SET_PDEATHSIG, 0);
    (void)setsid();
    const int null = open("/dev/null", O_RDWR | O_NOFOLLOW | O_CLOEXEC);
    (void)dup2(null, STDIN_FILENO);
    (void)dup2(null, STDOUT_FILENO);
    (void)close(null);
    (void)!write(ready, "", 1);
    (void)close(ready);
}
