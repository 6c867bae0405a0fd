/* SPDX-License-Identifier: MIT
 *
 * folder.c - the folder that a path ends in, held open, and the name there.
 */
#include "base/file/folder.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <string.h>
#include <unistd.h>

int folder_open(folder *f, const char *path)
{
    const char *slash = strrchr(path, '/');
    char text[PATH_MAX] = ".";
    size_t length = slash ? (size_t)(slash - path) + 1 : 0;
    *f = (folder)FOLDER_NONE;
    if (length >= sizeof text)
        return ENAMETOOLONG;
    memcpy(text, path, length);
    f->name = path + length;
    f->fd = open(text, O_PATH | O_DIRECTORY | O_CLOEXEC);
    return f->fd < 0 ? errno : 0;
}

void folder_close(folder *f)
{
    if (f->fd >= 0)
        (void)close(f->fd);
    f->fd = -1;
}
