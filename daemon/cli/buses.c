/* SPDX-License-Identifier: MIT
 *
 * buses.c - the buses that run on this machine, by their control sockets.
 */
#include "cli/buses.h"

#include <dirent.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define FOLDER_DEFAULT "/run/canwire"
#define SUFFIX ".sock" /* of the socket of a bus */

const char *buses_folder(void)
{
    const char *folder = getenv("CANWIRE_RUN");
    return folder && *folder ? folder : FOLDER_DEFAULT;
}

/* Returns true for a name that needs no quoting, also for Wireshark. */
static bool is_plain(const char *name, size_t length)
{
    for (size_t i = 0; i < length; i++)
        if (name[i] <= ' ' || name[i] == '{' || name[i] == '}' || name[i] == 0x7F)
            return false;
    return length > 0;
}

/* Returns true when a canwired listens there, and not a port, nor nobody. */
static bool is_running(const char *name)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    int length =
        snprintf(address.sun_path, sizeof address.sun_path, "%s/%s", buses_folder(), name);
    if (length < 0 || (size_t)length >= sizeof address.sun_path)
        return false;
    int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    bool found = fd >= 0 && connect(fd, (const struct sockaddr *)&address, sizeof address) == 0;
    if (fd >= 0)
        (void)close(fd);
    return found;
}

static int is_bus(const struct dirent *file)
{
    const char *name = file->d_name;
    const size_t length = strlen(name), end = strlen(SUFFIX);
    return length > end && strcmp(name + length - end, SUFFIX) == 0 &&
           is_plain(name, length - end) && is_running(name);
}

size_t buses_find(char *names[], size_t most)
{
    struct dirent **files;
    size_t count = 0;
    const int found = scandir(buses_folder(), &files, is_bus, alphasort);
    for (int i = 0; i < found; i++) {
        const char *name = files[i]->d_name;
        char *copy = count < most ? strndup(name, strlen(name) - strlen(SUFFIX)) : NULL;
        if (copy)
            names[count++] = copy;
        free(files[i]);
    }
    if (found >= 0)
        free(files);
    return count;
}
