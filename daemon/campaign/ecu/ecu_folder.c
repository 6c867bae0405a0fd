/* SPDX-License-Identifier: MIT
 *
 * ecu_folder.c - the folders of a row: one for its files, and a short one for its sockets.
 */
#include "campaign/ecu/ecu_folder.h"

#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#define MODE 0777           /* of folders, less the umask */
#define FILE_MODE 0666      /* of files, in the same way */
#define TEMPORARY_MAX 40u   /* bytes of $TMPDIR that leave room for names of sockets */
#define TRIES 8             /* to make the folder of a row, which another run may make, too */
#define OPEN_MAX_FOLDERS 16 /* at a time, while one is removed */

static bool fail(char why[ECU_WHY_MAX], const char *path)
{
    const int error = errno;
    (void)snprintf(why, ECU_WHY_MAX, "%.200s: %s", path, strerror(error));
    return false;
}

/* ---- Removing -------------------------------------------------------------------------------- */

static int remove_one(const char *path, const struct stat *found, int type, struct FTW *place)
{
    (void)found;
    (void)place;
    (void)unlinkat(AT_FDCWD, path, type == FTW_DP ? AT_REMOVEDIR : 0);
    return 0;
}

void ecu_folder_remove(const char *path)
{
    (void)nftw(path, remove_one, OPEN_MAX_FOLDERS, FTW_DEPTH | FTW_PHYS);
}

/* ---- Making ---------------------------------------------------------------------------------- */

void ecu_folder_path(char out[PATH_MAX], const char *work, uint64_t row)
{
    (void)snprintf(out, PATH_MAX, "%.*s/row-%" PRIu64, PATH_MAX - 64, work, row);
}

/* Removes what an earlier run has left: a folder with the scenario of a row in it. */
static void clear(const char *path)
{
    char scenario[PATH_MAX + 16];
    struct stat found;
    (void)snprintf(scenario, sizeof scenario, "%s/" ECU_SCENARIO, path);
    if (fstatat(AT_FDCWD, scenario, &found, AT_SYMLINK_NOFOLLOW) == 0)
        ecu_folder_remove(path);
}

/* Returns true when a folder is still the one with that name. */
static bool has_name(int fd, const char *path)
{
    struct stat own, there;
    return fstat(fd, &own) == 0 && fstatat(AT_FDCWD, path, &there, AT_SYMLINK_NOFOLLOW) == 0 &&
           own.st_dev == there.st_dev && own.st_ino == there.st_ino;
}

/* Opens a folder and waits for its lock. Returns -1 without one; it may be gone by then. */
static int open_folder(const char *path)
{
    const int fd = open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0 || (flock(fd, LOCK_EX) == 0 && has_name(fd, path)))
        return fd;
    (void)close(fd);
    return -1;
}

/* Makes an empty folder that is locked. Returns false with errno: another program may have been
 * faster, or have removed the folder of all rows. */
static bool try_files(ecu_folder *f, const char *work)
{
    if (mkdirat(AT_FDCWD, f->files, MODE) != 0) {
        const int error = errno;
        if (error == ENOENT)
            (void)mkdirat(AT_FDCWD, work, MODE);
        errno = error;
        return false;
    }
    f->fd = open_folder(f->files);
    return f->fd >= 0;
}

/* The folder is locked as long as somebody works in it. That may be another run of this row, or the
 * keeper of an earlier try, which ends its programs. */
static bool make_files(ecu_folder *f, const char *work, char why[ECU_WHY_MAX])
{
    bool good = false;
    for (unsigned i = 0; i < TRIES && !good; i++) {
        const int before = open_folder(f->files);
        if (before >= 0)
            clear(f->files);
        good = try_files(f, work) || (i + 1 == TRIES && fail(why, f->files));
        if (before >= 0)
            (void)close(before);
    }
    return good;
}

static bool make_sockets(ecu_folder *f, char why[ECU_WHY_MAX])
{
    const char *temporary = getenv("TMPDIR");
    if (!temporary || *temporary != '/' || strlen(temporary) > TEMPORARY_MAX)
        temporary = "/tmp";
    (void)snprintf(f->sockets, sizeof f->sockets, "%s/canwire-XXXXXX", temporary);
    if (mkdtemp(f->sockets))
        return true;
    const bool good = fail(why, temporary);
    f->sockets[0] = '\0';
    return good;
}

bool ecu_folder_make(ecu_folder *f, const char *work, uint64_t row, char why[ECU_WHY_MAX])
{
    f->fd = -1;
    f->sockets[0] = '\0';
    ecu_folder_path(f->files, work, row);
    if (!make_files(f, work, why) || !make_sockets(f, why))
        return false;
    return symlinkat(f->sockets, f->fd, ECU_SOCKETS) == 0 || fail(why, f->files);
}

bool ecu_folder_add(const ecu_folder *f, const char *name)
{
    return mkdirat(f->fd, name, MODE) == 0;
}

int ecu_folder_open(const ecu_folder *f, const char *name)
{
    return openat(f->fd, name, O_WRONLY | O_CREAT | O_EXCL | O_APPEND | O_NOFOLLOW | O_CLOEXEC,
                  FILE_MODE);
}

void ecu_folder_close(ecu_folder *f)
{
    if (f->sockets[0] != '\0')
        ecu_folder_remove(f->sockets);
    if (f->fd >= 0)
        (void)unlinkat(f->fd, ECU_SOCKETS, 0);
    f->sockets[0] = '\0';
    if (f->fd >= 0)
        (void)close(f->fd);
    f->fd = -1;
}
