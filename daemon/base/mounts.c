/* SPDX-License-Identifier: MIT
 *
 * mounts.c - what the next start of the service may write to.
 */
#include "base/mounts.h"

#include "base/file/folder.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define MOUNTS_MAX 1024u

typedef struct mount_seen {
    int id;
    int parent;
    bool read_only;
} mount_seen;

static mount_seen mounts[MOUNTS_MAX]; /* at the start */
static size_t mount_count;

/* Returns the number of mounts that this process sees; further ones are left out. */
static size_t read_mounts(mount_seen *all, size_t most)
{
    size_t count = 0, size = 0;
    char *line = NULL, options[8];
    FILE *in = fopen("/proc/self/mountinfo", "re");
    while (in && count < most && getline(&line, &size, in) > 0) {
        mount_seen *one = &all[count];
        if (sscanf(line, "%d %d %*s %*s %*s %7[^ ,]", &one->id, &one->parent, options) != 3)
            continue;
        one->read_only = strcmp(options, "ro") == 0;
        count++;
    }
    free(line);
    if (in)
        (void)fclose(in);
    return count;
}

static const mount_seen *find_mount(const mount_seen *all, size_t count, int id)
{
    for (size_t i = 0; i < count; i++)
        if (all[i].id == id)
            return &all[i];
    return NULL;
}

/* Returns the mount that a folder is in, or -1. */
static int mount_of(const char *file)
{
    struct statx found;
    folder in;
    int id = -1;
    if (folder_open(&in, file) == 0 &&
        statx(in.fd, "", AT_EMPTY_PATH, STATX_MNT_ID, &found) == 0 &&
        found.stx_mask & STATX_MNT_ID)
        id = (int)found.stx_mnt_id;
    folder_close(&in);
    return id;
}

void mounts_remember(void)
{
    mount_count = read_mounts(mounts, MOUNTS_MAX);
}

int mounts_forecast(const char *file)
{
    const mount_seen *then, *one;
    mount_seen now[MOUNTS_MAX];
    if (mount_count == 0)
        return 0;
    const size_t count = read_mounts(now, MOUNTS_MAX);
    int id = mount_of(file);
    for (size_t i = 0; i < count; i++) {
        if ((then = find_mount(mounts, mount_count, id)) != NULL)
            return then->read_only ? EROFS : 0;
        if (!(one = find_mount(now, count, id)))
            return 0;
        id = one->parent;
    }
    return 0;
}
