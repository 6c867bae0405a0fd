/* SPDX-License-Identifier: MIT
 *
 * ecu_folder.c - the folders of a row: one for its files, and a short one for its sockets.
 */
#include "campaign/ecu/ecu_folder.h"

#include <dirent.h>
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
#define TRIES 1000          /* to get the folder of a row, which other runs make and remove, too */
#define OPEN_MAX_FOLDERS 16 /* at a time, while one is removed */

static bool ecu_folder_fail(char why[ECU_WHY_MAX], const char *path)
{
    const int error = errno;
    (void)snprintf(why, ECU_WHY_MAX, "%.200s: %s", path, strerror(error));
    return false;
}

/* ---- Removing -------------------------------------------------------------------------------- */

/* Files that cannot be removed stay; the others go all the same. */
static int remove_one(const char *path, const struct stat *found, int type, struct FTW *place)
{
    (void)found;
    (void)place;
    (void)unlinkat(AT_FDCWD, path, type == FTW_DP ? AT_REMOVEDIR : 0);
    return 0;
}

static int remove_inner(const char *path, const struct stat *found, int type, struct FTW *place)
{
    return place->level > 0 ? remove_one(path, found, type, place) : 0;
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

/* Returns true when a folder is still the one with that name. */
static bool ecu_folder_has_name(int fd, const char *path)
{
    struct stat own, there;
    return fstat(fd, &own) == 0 && fstatat(AT_FDCWD, path, &there, AT_SYMLINK_NOFOLLOW) == 0 &&
           own.st_dev == there.st_dev && own.st_ino == there.st_ino;
}

/* Opens a folder and waits for its lock. Returns -1 without one; it may be gone by then. */
static int open_folder(const char *path)
{
    const int fd = open(path, O_RDONLY | O_DIRECTORY | O_NOFOLLOW | O_CLOEXEC);
    if (fd < 0 || (flock(fd, LOCK_EX) == 0 && ecu_folder_has_name(fd, path)))
        return fd;
    (void)close(fd);
    return -1;
}

static bool has(int fd, const char *name)
{
    struct stat found;
    return fstatat(fd, name, &found, AT_SYMLINK_NOFOLLOW) == 0;
}

/* Returns true for a folder without entries. It reads through a descriptor of its own, which
 * closedir() closes. */
static bool is_empty(int fd)
{
    const int copy = openat(fd, ".", O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    DIR *folder = copy >= 0 ? fdopendir(copy) : NULL;
    unsigned entries = 0;
    while (folder && entries <= 2 && readdir(folder)) /* "." and ".." */
        entries++;
    if (folder)
        (void)closedir(folder);
    else if (copy >= 0)
        (void)close(copy);
    return folder && entries <= 2;
}

/* Takes a folder that is locked. Files that an earlier run has left go; the first of them is the
 * link to the sockets, the next one the scenario. A folder with other files stays as it is. */
static bool ecu_folder_take(int fd, const char *path)
{
    if (has(fd, ECU_SCENARIO) || has(fd, ECU_SOCKETS))
        (void)nftw(path, remove_inner, OPEN_MAX_FOLDERS, FTW_DEPTH | FTW_PHYS);
    return is_empty(fd);
}

/* Makes the folder of the row, and that of all rows, which another run may have removed. Returns an
 * errno, also when it is there. */
static int ecu_folder_make_one(const char *path, const char *work)
{
    errno = EEXIST;
    if (mkdirat(AT_FDCWD, path, MODE) == 0 || errno != ENOENT)
        return errno;
    (void)mkdirat(AT_FDCWD, work, MODE);
    return ENOENT;
}

/* The folder is locked as long as somebody works in it. That may be another run of this row, or the
 * keeper of an earlier try, which ends its programs. It is taken by its lock, not by making it: the
 * lock is what one run alone can have. Each run that ends removes it, so those that wait look for
 * it again. */
static bool make_files(ecu_folder *f, const char *work, char why[ECU_WHY_MAX])
{
    for (unsigned i = 0; i < TRIES; i++) {
        const int error = ecu_folder_make_one(f->files, work);
        const int fd = open_folder(f->files);
        errno = error;
        if (fd < 0)
            continue;
        if (ecu_folder_take(fd, f->files)) {
            f->fd = fd;
            return true;
        }
        (void)close(fd);
        errno = EEXIST;
        break;
    }
    return ecu_folder_fail(why, f->files);
}

/* Makes the folder of sockets. It is not that of files: paths of sockets have at most 107 bytes. */
static bool make_sockets(ecu_folder *f, char why[ECU_WHY_MAX])
{
    const char *temporary = getenv("TMPDIR");
    if (!temporary || *temporary != '/' || strlen(temporary) > TEMPORARY_MAX)
        temporary = "/tmp";
    (void)snprintf(f->sockets, sizeof f->sockets, "%s/canwire-XXXXXX", temporary);
    if (mkdtemp(f->sockets))
        return true;
    const bool good = ecu_folder_fail(why, temporary);
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
    return symlinkat(f->sockets, f->fd, ECU_SOCKETS) == 0 || ecu_folder_fail(why, f->files);
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
