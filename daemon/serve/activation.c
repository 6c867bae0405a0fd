/* SPDX-License-Identifier: MIT
 *
 * activation.c - sockets that the service manager has opened for canwired (sd_listen_fds(3)).
 */
#include "serve/start.h"

#include "base/text/jsonput.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#define REFUSED_MAX 1024u /* clients that wait */

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

void activation_refuse(const char *name, const char *why)
{
    char error[ACTIVATION_ERROR_MAX];
    int listening;
    if (activation_take(&listening, name, error))
        activation_answer(listening, why);
}

void activation_answer(int listening, const char *why)
{
    int fd;
    if (listening < 0)
        return;
    json_t *reply = json_object();
    put_bool(reply, "ok", false);
    put_text(reply, "error", why);
    char *text = json_dumps(reply, JSON_COMPACT);
    const int flags = fcntl(listening, F_GETFL);
    (void)fcntl(listening, F_SETFL, flags | O_NONBLOCK);
    for (unsigned i = 0; i < REFUSED_MAX && text && (fd = accept4(listening, NULL, NULL,
                                                                 SOCK_CLOEXEC)) >= 0; i++) {
        (void)send(fd, text, strlen(text), MSG_NOSIGNAL | MSG_DONTWAIT);
        (void)send(fd, "\n", 1, MSG_NOSIGNAL | MSG_DONTWAIT);
        (void)close(fd);
    }
    (void)fcntl(listening, F_SETFL, flags);
    free(text);
    json_decref(reply);
}
