/* SPDX-License-Identifier: MIT
 *
 * outfile.c - an output file, which keeps its old content until the first output.
 */
#include "cli/outfile.h"

#include "base/file/filelock.h"
#include "base/text/plain.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define MODE 0666 /* less the umask */
#define BUFFER_BYTES (256u << 10)
#define REASON_BYTES 200u

static bool outfile_complain(const outfile *self, const char *why, const char *program)
{
    plain_print(stderr, "%s: %s: %s\n", program, self->name, why);
    return false;
}

/* Opens the file without changing it. Returns a file descriptor, or -1. */
static int open_as_it_is(outfile *self)
{
    int fd = open(self->name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, MODE);
    self->made = fd >= 0;
    if (fd < 0 && errno == EEXIST)
        fd = open(self->name, O_WRONLY | O_CREAT | O_CLOEXEC, MODE);
    return fd;
}

/* Makes the buffer larger, but not that of a terminal, which must show lines at once. Without
 * memory stdio's own buffer stays. */
static void enlarge_buffer(outfile *self)
{
    static char of_stdout[BUFFER_BYTES]; /* outlives this call */
    if (isatty(fileno(self->stream)))
        return;
    if (self->stream != stdout)
        self->buffer = malloc(BUFFER_BYTES);
    char *buffer = self->stream == stdout ? of_stdout : self->buffer;
    if (buffer)
        (void)setvbuf(self->stream, buffer, _IOFBF, BUFFER_BYTES);
}

/* Returns true when another program writes the file. Pipes and terminals may have several
 * writers. */
static bool is_busy(int fd)
{
    struct stat status;
    return fstat(fd, &status) == 0 && S_ISREG(status.st_mode) && filelock_take(fd) != 0;
}

bool outfile_open(outfile *self, const char *name, const char *program)
{
    *self = (outfile){.name = name};
    if (!name)
        return true;
    if (strcmp(name, "-") == 0) {
        self->stream = stdout;
        enlarge_buffer(self);
        return true;
    }
    int fd = open_as_it_is(self);
    bool busy = fd >= 0 && is_busy(fd);
    self->stream = fd >= 0 && !busy ? fdopen(fd, "w") : NULL;
    if (self->stream) {
        enlarge_buffer(self);
        return true;
    }
    bool good =
        outfile_complain(self, busy ? "another program is writing it" : strerror(errno), program);
    if (fd >= 0)
        (void)close(fd);
    return good;
}

/* Empties the file at the first call. A pipe or a terminal cannot be cut, and has no old
 * content. */
FILE *outfile_begin(outfile *self)
{
    if (self->stream && self->stream != stdout && !self->begun)
        (void)!ftruncate(fileno(self->stream), 0);
    self->begun = true;
    return self->stream;
}

/* Removes a file that was made, but never written to. */
static bool remove_again(const outfile *self, const char *program)
{
    char why[REASON_BYTES];
    if (unlink(self->name) == 0 || errno == ENOENT)
        return true;
    (void)snprintf(why, sizeof why, "it is empty and cannot be removed: %s", strerror(errno));
    return outfile_complain(self, why, program);
}

bool outfile_close(outfile *self, const char *program)
{
    FILE *stream = self->stream;
    if (!stream)
        return true;
    bool failed = ferror(stream) != 0;
    bool closed = (stream == stdout ? fflush(stream) : fclose(stream)) == 0;
    self->stream = NULL;
    free(self->buffer);
    self->buffer = NULL;
    if (!closed || failed)
        (void)outfile_complain(self, closed ? "not all could be written" : strerror(errno),
                               program);
    bool left = self->begun || !self->made || remove_again(self, program);
    return closed && !failed && left;
}
