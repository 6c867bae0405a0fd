/* SPDX-License-Identifier: MIT
 *
 * claim.c - an interface belongs to one canwired at a time.
 */
#include "port/claim.h"

#include <errno.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define SOCKETS_FILE "/proc/self/net/unix" /* list of the abstract namespace, among others */
#define LINE_BYTES 512
#define NAME_BYTES 108 /* of sun_path, with a 0 before the name; numbers and texts are shorter */
#define PREFIX_BYTES 32
#define BUS_NAME_MAX 40

/* Returns a socket with an abstract name; -1 with errno set. */
static int bind_name(const char *name)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    size_t length = strlen(name);
    memcpy(address.sun_path + 1, name, length); /* behind a 0: abstract */
    int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return -1;
    socklen_t size = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + 1 + length);
    if (bind(fd, (const struct sockaddr *)&address, size) == 0)
        return fd;
    int error = errno;
    (void)close(fd);
    errno = error;
    return -1;
}

/* Finds the owner's text behind the prefix of its name; returns false when there is none. */
static bool find_owner(char out[NAME_BYTES], const char *prefix)
{
    char line[LINE_BYTES];
    bool found = false;
    FILE *sockets = fopen(SOCKETS_FILE, "re");
    while (sockets && !found && fgets(line, sizeof line, sockets)) {
        const char *name = strchr(line, '@');
        found = name && strncmp(name + 1, prefix, strlen(prefix)) == 0;
        if (found)
            (void)snprintf(out, NAME_BYTES, "%.*s", (int)strcspn(name + 1 + strlen(prefix), "\n"),
                           name + 1 + strlen(prefix));
    }
    if (sockets)
        (void)fclose(sockets);
    return found;
}

/* Writes the reason from the owner's text, PID/BUS. */
static void explain_owner(char *error, size_t size, const char *prefix)
{
    char owner[NAME_BYTES];
    char *bus = find_owner(owner, prefix) ? strchr(owner, '/') : NULL;
    if (bus)
        (void)snprintf(error, size, "in use by bus %s of canwired, pid %.*s", bus + 1,
                       (int)(bus - owner), owner);
    else
        (void)snprintf(error, size, "in use by another canwired");
}

bool claim_take(claim *c, unsigned index, const char *bus, char *error, size_t error_size)
{
    char lock[PREFIX_BYTES];
    char prefix[PREFIX_BYTES];
    char owner[NAME_BYTES];
    *c = (claim)CLAIM_NONE;
    (void)snprintf(lock, sizeof lock, "canwire/port/%u", index);
    (void)snprintf(prefix, sizeof prefix, "canwire/owner/%u/", index);
    (void)snprintf(owner, sizeof owner, "%s%ld/%.*s", prefix, (long)getpid(), BUS_NAME_MAX, bus);
    c->lock = bind_name(lock);
    if (c->lock < 0 && errno == EADDRINUSE) {
        explain_owner(error, error_size, prefix);
        return false;
    }
    if (c->lock >= 0)
        c->owner = bind_name(owner);
    if (c->owner >= 0)
        return true;
    (void)snprintf(error, error_size, "cannot be claimed: %s", strerror(errno));
    claim_release(c);
    return false;
}

void claim_release(claim *c)
{
    if (c->owner >= 0)
        (void)close(c->owner);
    if (c->lock >= 0)
        (void)close(c->lock);
    *c = (claim)CLAIM_NONE;
}
