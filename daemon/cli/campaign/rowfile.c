/* SPDX-License-Identifier: MIT
 *
 * rowfile.c - the file of rows: it is there when all rows are in it, and never in part.
 */
#include "cli/campaign/rowfile.h"

#include "base/file/filelock.h"
#include "base/text/plain.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <limits.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define LINKS_MAX 40u /* the kernel follows as many */
#define MODE 0666 /* less the umask */
#define TRIES 40u /* to open a part: processes of a run that was killed hold it a little longer */
#define WAIT_US 25000u /* between two tries */

static bool rowfile_complain(const char *name, const char *why)
{
    plain_print(stderr, "canwire campaign: %s: %s\n", name, why);
    return false;
}

/* Gives all whole lines to the caller. Returns where they end, or -1 after a message. */
static off_t check_lines(const char *name, FILE *in, rowfile_check *check,
                         void *user)
{
    char *line = NULL;
    size_t room = 0;
    off_t end = 0;
    bool good = true;
    for (ssize_t length; good && (length = getline(&line, &room, in)) > 0;) {
        if (line[length - 1] != '\n')
            break; /* the program has been killed in the middle of it */
        good = check(user, line, (size_t)length);
        end += length;
    }
    free(line);
    if (good && !ferror(in))
        return end;
    (void)rowfile_complain(name,
                           good ? strerror(errno)
                                : "it has other rows than this campaign; remove it, or leave out "
                                  "--resume");
    return -1;
}

/* Reads the file that has its name. Returns false after a message. */
static bool open_whole(rowfile *f, rowfile_check *check, void *user)
{
    FILE *in = fopen(f->name, "re");
    if (!in && errno == ENOENT)
        return true;
    if (!in)
        return rowfile_complain(f->name, strerror(errno));
    f->whole = true;
    const bool good = check_lines(f->name, in, check, user) >= 0;
    (void)fclose(in);
    return good;
}

/* Keeps the whole lines of a part, and goes on behind them. */
static bool continue_part(rowfile *f, rowfile_check *check, void *user)
{
    FILE *in = fopen(f->part, "re");
    const off_t end = in ? check_lines(f->part, in, check, user) : -1;
    if (!in)
        return rowfile_complain(f->part, strerror(errno));
    (void)fclose(in);
    if (end < 0)
        return false;
    if (ftruncate(fileno(f->stream), end) != 0 || fseeko(f->stream, end, SEEK_SET) != 0)
        return rowfile_complain(f->part, strerror(errno));
    return true;
}

/* Returns true when a file is still the one with that name. */
static bool rowfile_has_name(int fd, const char *name)
{
    struct stat own;
    struct stat there;
    return fstat(fd, &own) == 0 && stat(name, &there) == 0 && own.st_dev == there.st_dev &&
           own.st_ino == there.st_ino;
}

/* Opens the part and takes its lock, within a second. Returns -1 after a message. Another program
 * may end between both, and give the part its last name: then the part is opened anew. */
static int open_locked(const char *part)
{
    for (unsigned i = 0; i < TRIES; i++) {
        const int fd = open(part, O_RDWR | O_CREAT | O_CLOEXEC, MODE);
        if (fd < 0) {
            (void)rowfile_complain(part, strerror(errno));
            return -1;
        }
        if (filelock_take(fd) == 0 && rowfile_has_name(fd, part))
            return fd;
        (void)close(fd);
        (void)usleep(WAIT_US);
    }
    (void)rowfile_complain(part, "another program is writing it");
    return -1;
}

/* Opens the part of a file of rows, locked: two runs would mix their rows. */
static bool open_part(rowfile *f)
{
    const int fd = open_locked(f->part);
    if (fd < 0)
        return false;
    f->stream = fdopen(fd, "r+");
    if (f->stream)
        return true;
    (void)close(fd);
    return rowfile_complain(f->part, strerror(errno));
}

/* Takes the name that a link has, where no file is yet. */
static bool follow(rowfile *f)
{
    char target[PATH_MAX];
    const ssize_t length = readlink(f->name, target, sizeof target - 1);
    if (length < 0)
        return errno == EINVAL || errno == ENOENT || rowfile_complain(f->name, strerror(errno));
    target[length] = '\0';
    const char *slash = *target == '/' ? NULL : strrchr(f->name, '/');
    char *real = NULL;
    if (asprintf(&real, "%.*s%s", slash ? (int)(slash - f->name) + 1 : 0, f->name, target) < 0)
        return rowfile_complain(f->name, strerror(ENOMEM));
    free(f->real);
    f->real = real;
    f->name = real;
    return true;
}

/* A file that is not there yet may have links to it. */
static bool find_new(rowfile *f)
{
    struct stat found;
    bool good = true;
    for (unsigned i = 0; i < LINKS_MAX && good && lstat(f->name, &found) == 0; i++)
        good = follow(f);
    return good;
}

static bool open_as_it_is(rowfile *f)
{
    f->stream = fopen(f->name, "we");
    return f->stream || rowfile_complain(f->name, strerror(errno));
}

/* The file gets its name in the end, which must replace no device and no link. */
static bool find_real(rowfile *f)
{
    struct stat found;
    if (stat(f->name, &found) != 0)
        return errno == ENOENT ? find_new(f) : rowfile_complain(f->name, strerror(errno));
    if (!S_ISREG(found.st_mode) && !f->kept)
        return open_as_it_is(f);
    if (!S_ISREG(found.st_mode))
        return rowfile_complain(f->name, "it is no regular file");
    f->real = realpath(f->name, NULL);
    if (!f->real)
        return rowfile_complain(f->name, strerror(errno));
    f->name = f->real;
    return true;
}

bool rowfile_open(rowfile *f, const char *name, bool resume, rowfile_check *check, void *user)
{
    *f = (rowfile){.name = name, .stream = name ? NULL : stdout, .kept = check != NULL};
    if (!name)
        return true;
    if (!find_real(f))
        return false;
    if (f->stream)
        return true;
    if (resume && !open_whole(f, check, user))
        return false;
    if (f->whole)
        return true;
    if (asprintf(&f->part, "%s.part", f->name) < 0) {
        f->part = NULL;
        return rowfile_complain(name, "out of memory");
    }
    if (!open_part(f))
        return false;
    if (resume)
        return continue_part(f, check, user);
    return ftruncate(fileno(f->stream), 0) == 0 || rowfile_complain(f->part, strerror(errno));
}

/* Makes a new name of a file safe. Not all file systems can do that. */
static bool sync_folder(const char *name)
{
    char *copy = strdup(name);
    const int fd = copy ? open(dirname(copy), O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;
    free(copy);
    if (fd < 0)
        return errno == EACCES || rowfile_complain(name, strerror(errno));
    const bool good = fsync(fd) == 0 || errno == EINVAL || rowfile_complain(name, strerror(errno));
    (void)close(fd);
    return good;
}

/* Makes the rows safe before the file gets its name. */
static bool rowfile_finish(const rowfile *f)
{
    if (fflush(f->stream) != 0 || ferror(f->stream) || fsync(fileno(f->stream)) != 0)
        return rowfile_complain(f->part, strerror(errno));
    if (rename(f->part, f->name) != 0)
        return rowfile_complain(f->name, strerror(errno));
    return sync_folder(f->name);
}

/* A device or a pipe is complete as it is. */
static bool rowfile_flush(const rowfile *f)
{
    return (fflush(f->stream) == 0 && !ferror(f->stream)) ||
           rowfile_complain(f->name, strerror(errno));
}

bool rowfile_close(rowfile *f, bool done)
{
    bool good = true;
    if (f->name && f->stream) {
        good = !done || (f->part ? rowfile_finish(f) : rowfile_flush(f));
        if (!done && !f->kept && f->part)
            (void)unlink(f->part);
        if (fclose(f->stream) != 0 && good)
            good = rowfile_complain(done || !f->part ? f->name : f->part, strerror(errno));
    }
    free(f->part);
    free(f->real);
    f->part = NULL;
    f->real = NULL;
    f->stream = NULL;
    return good;
}
