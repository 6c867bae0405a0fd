/* SPDX-License-Identifier: MIT
 *
 * activation.c - sockets that the service manager has opened for canwired (sd_listen_fds(3)).
 */
#include "serve/activation.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <systemd/sd-daemon.h>

static void free_names(char **names, int count)
{
    for (int i = 0; names && i < count; i++)
        free(names[i]);
    free(names);
}

/* Keeps the other sockets open on exec, which sd_listen_fds() has changed: that distinguishes
 * inherited ports. */
static void leave_alone(int count, int taken)
{
    for (int fd = SD_LISTEN_FDS_START; fd < SD_LISTEN_FDS_START + count; fd++)
        if (fd != taken)
            (void)fcntl(fd, F_SETFD, 0);
}

bool activation_take(int *fd, const char *name, char error[ACTIVATION_ERROR_MAX])
{
    char **names = NULL;
    int count = sd_listen_fds_with_names(1, &names);
    *fd = -1;
    if (count < 0) {
        (void)snprintf(error, ACTIVATION_ERROR_MAX, "LISTEN_FDS: %s", strerror(-count));
        return false;
    }
    for (int i = 0; names && i < count && *fd < 0; i++)
        if (strcmp(names[i], name) == 0)
            *fd = SD_LISTEN_FDS_START + i;
    free_names(names, count);
    leave_alone(count, *fd);
    if (*fd < 0 || sd_is_socket_unix(*fd, SOCK_STREAM, 1, NULL, 0) > 0)
        return true;
    (void)snprintf(error, ACTIVATION_ERROR_MAX,
                   "LISTEN_FDNAMES: '%s' is no Unix stream socket that listens", name);
    return false;
}
