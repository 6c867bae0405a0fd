/* SPDX-License-Identifier: MIT
 *
 * claim.c - an interface belongs to one canwired at a time, and others can find out to which one.
 */
#include "port/claim.h"

#include "base/text/number.h"

#include <errno.h>
#include <limits.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define SOCKETS_FILE "/proc/self/net/unix" /* list of the abstract namespace, among others */
#define LINE_BYTES 512
#define NAME_BYTES 108 /* of sun_path, with a 0 before the name; numbers and texts are shorter */

/* Returns a socket with an abstract name; -1 with errno set. */
static int bind_name(const char *name)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    size_t length = strnlen(name, NAME_BYTES - 1);
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

void claim_print_port(char key[CLAIM_KEY_BYTES], unsigned index)
{
    (void)snprintf(key, CLAIM_KEY_BYTES, "port/%u", index);
}

static void print_prefix(char out[NAME_BYTES], const char *key)
{
    (void)snprintf(out, NAME_BYTES, "canwire/owner/%.*s/", CLAIM_KEY_BYTES - 1, key);
}

/* Reads PID/NAME, which is behind the prefix of an owner. */
static bool read_owner(claim_owner *owner, const char *text)
{
    uint64_t pid;
    if (!text_take_uint(&pid, &text, INT_MAX) || *text++ != '/')
        return false;
    owner->pid = (long)pid;
    (void)snprintf(owner->name, CLAIM_OWNER_BYTES, "%.*s", (int)strcspn(text, "\n"), text);
    return true;
}

bool claim_find(claim_owner *owner, const char *key)
{
    char line[LINE_BYTES], prefix[NAME_BYTES];
    bool found = false;
    print_prefix(prefix, key);
    FILE *sockets = fopen(SOCKETS_FILE, "re");
    while (sockets && !found && fgets(line, sizeof line, sockets)) {
        const char *name = strchr(line, '@');
        found = name && strncmp(name + 1, prefix, strlen(prefix)) == 0 &&
                read_owner(owner, name + 1 + strlen(prefix));
    }
    if (sockets)
        (void)fclose(sockets);
    return found;
}

int claim_take(claim *c, const char *key, const char *name)
{
    char lock[NAME_BYTES], prefix[NAME_BYTES], owner[2 * NAME_BYTES];
    *c = (claim)CLAIM_NONE;
    print_prefix(prefix, key);
    (void)snprintf(lock, sizeof lock, "canwire/%.*s", CLAIM_KEY_BYTES - 1, key);
    (void)snprintf(owner, sizeof owner, "%s%ld/%.*s", prefix, (long)getpid(),
                   CLAIM_OWNER_BYTES - 1, name);
    c->lock = bind_name(lock);
    if (c->lock >= 0)
        c->owner = bind_name(owner);
    if (c->owner >= 0)
        return 0;
    const int number = errno;
    claim_release(c);
    return number;
}

void claim_release(claim *c)
{
    if (c->owner >= 0)
        (void)close(c->owner);
    if (c->lock >= 0)
        (void)close(c->lock);
    *c = (claim)CLAIM_NONE;
}
