/* SPDX-License-Identifier: MIT
 *
 * ecu_control.c - asks the canwired of a row at its control socket, without waiting for it.
 */
#include "campaign/ecu/ecu_control.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define READ_BYTES (16u << 10)

bool ecu_control_open(ecu_control *c, const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    c->fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (c->fd >= 0 && connect(c->fd, (const struct sockaddr *)&address, sizeof address) == 0)
        return true;
    const int error = errno;
    ecu_control_close(c);
    errno = error;
    return false;
}

bool ecu_control_ask(const ecu_control *c, const char *request)
{
    const size_t length = strlen(request);
    return c->fd >= 0 && send(c->fd, request, length, MSG_NOSIGNAL) == (ssize_t)length;
}

void ecu_control_read(ecu_control *c)
{
    if (c->fd < 0 || !buffer_reserve(&c->in, READ_BYTES))
        return;
    const ssize_t count = recv(c->fd, c->in.data + c->in.end, READ_BYTES, MSG_DONTWAIT);
    if (count > 0)
        c->in.end += (size_t)count;
    else if (count == 0 || (errno != EAGAIN && errno != EINTR))
        ecu_control_close(c);
}

json_t *ecu_control_next(ecu_control *c)
{
    const char *first = buffer_first(&c->in);
    const size_t length = buffer_length(&c->in);
    const char *end = length > 0 ? memchr(first, '\n', length) : NULL;
    if (!end)
        return NULL;
    json_t *line = json_loadb(first, (size_t)(end - first), 0, NULL);
    buffer_take(&c->in, (size_t)(end - first) + 1);
    return line ? line : json_object();
}

void ecu_control_close(ecu_control *c)
{
    if (c->fd >= 0)
        (void)close(c->fd);
    c->fd = -1;
    buffer_free(&c->in);
}
