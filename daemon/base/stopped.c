/* SPDX-License-Identifier: MIT
 *
 * stopped.c - children that somebody has stopped.
 */
#include "base/stopped.h"

#include <signal.h>
#include <sys/wait.h>

bool stopped_go_on(pid_t child)
{
    siginfo_t found = {.si_pid = 0};
    if (waitid(P_PID, (id_t)child, &found, WSTOPPED | WNOHANG) != 0 || found.si_pid != child ||
        found.si_status != SIGSTOP)
        return false;
    return kill(child, SIGCONT) == 0;
}
