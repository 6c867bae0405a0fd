/* SPDX-License-Identifier: MIT
 *
 * run_fit.c - warns of programs that the library of canwire run cannot reach.
 */
#include "cli/run_fit.h"

#include "base/plain.h"

#include <elf.h>
#include <fcntl.h>
#include <limits.h>
#include <link.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define OWN_CLASS (sizeof(void *) == 8 ? ELFCLASS64 : ELFCLASS32)
#define SEGMENTS_MAX 64u

/* Opens a program of PATH. Returns -1 when it is not found. */
static int open_found(const char *program)
{
    char path[PATH_MAX];
    const char *folder = getenv("PATH");
    if (strchr(program, '/'))
        return open(program, O_RDONLY | O_CLOEXEC);
    for (; folder && *folder; folder += *folder == ':') {
        const int length = (int)strcspn(folder, ":");
        if (length < PATH_MAX / 2 &&
            snprintf(path, sizeof path, "%.*s/%s", length, folder, program) < PATH_MAX &&
            access(path, X_OK) == 0)
            return open(path, O_RDONLY | O_CLOEXEC);
        folder += length;
    }
    return -1;
}

/* Returns true when the program names a dynamic linker. */
static bool has_linker(int fd, const ElfW(Ehdr) *head)
{
    ElfW(Phdr) segment;
    const unsigned count = head->e_phnum < SEGMENTS_MAX ? head->e_phnum : SEGMENTS_MAX;
    for (unsigned i = 0; i < count; i++) {
        const off_t at = (off_t)(head->e_phoff + i * sizeof segment);
        if (pread(fd, &segment, sizeof segment, at) != (ssize_t)sizeof segment)
            return true;
        if (segment.p_type == PT_INTERP)
            return true;
    }
    return false;
}

/* Returns the reason why the library does not reach a program, or NULL. */
static const char *why_not(int fd)
{
    ElfW(Ehdr) head;
    struct stat found;
    if (pread(fd, &head, sizeof head, 0) != (ssize_t)sizeof head ||
        memcmp(head.e_ident, ELFMAG, SELFMAG) != 0)
        return NULL;
    if (head.e_ident[EI_CLASS] != OWN_CLASS)
        return "it has another word width than canwire";
    if (!has_linker(fd, &head))
        return "it is linked statically";
    if (fstat(fd, &found) == 0 && (found.st_mode & (S_ISUID | S_ISGID)) && geteuid() != 0)
        return "it has more rights than its user (setuid)";
    return NULL;
}

void run_warn_of(const char *program)
{
    const int fd = open_found(program);
    const char *why = fd >= 0 ? why_not(fd) : NULL;
    if (fd >= 0)
        (void)close(fd);
    if (why)
        plain_print(stderr, "canwire run: %s will find no interfaces: %s; see canwire-run(7)\n",
                    program, why);
}
