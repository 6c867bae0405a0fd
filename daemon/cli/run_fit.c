/* SPDX-License-Identifier: MIT
 *
 * run_fit.c - warns of programs that the library of canwire run cannot reach.
 */
#include "cli/run_fit.h"

#include "base/text/plain.h"

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
#define SEGMENT_BYTES 1024u /* of one that are looked at */

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

/* Properties of a program, by its segments. */
typedef struct traits {
    bool has_linker; /* it names a dynamic linker */
    bool musl;       /* ... that of musl */
    bool go;         /* the Go compiler has left a note */
} traits;

/* Reads the beginning of a segment as bytes that end with a 0. */
static size_t read_segment(char out[SEGMENT_BYTES], int fd, const ElfW(Phdr) *segment)
{
    const size_t size =
        segment->p_filesz < SEGMENT_BYTES - 1 ? segment->p_filesz : SEGMENT_BYTES - 1;
    const ssize_t count = pread(fd, out, size, (off_t)segment->p_offset);
    out[count > 0 ? count : 0] = '\0';
    return count > 0 ? (size_t)count : 0;
}

/* Returns true when one of the notes in a segment is by "Go". */
static bool has_go_note(const char *notes, size_t size)
{
    ElfW(Nhdr) note;
    for (size_t at = 0; at + sizeof note + sizeof "Go" <= size;) {
        memcpy(&note, notes + at, sizeof note);
        if (note.n_namesz == 4 && memcmp(notes + at + sizeof note, "Go", sizeof "Go") == 0)
            return true;
        if (note.n_namesz > size || note.n_descsz > size)
            return false;
        at += sizeof note + (note.n_namesz + 3u) / 4u * 4u + (note.n_descsz + 3u) / 4u * 4u;
    }
    return false;
}

static traits read_traits(int fd, const ElfW(Ehdr) *head)
{
    traits found = {.has_linker = false};
    ElfW(Phdr) segment;
    char bytes[SEGMENT_BYTES];
    const unsigned count = head->e_phnum < SEGMENTS_MAX ? head->e_phnum : SEGMENTS_MAX;
    for (unsigned i = 0; i < count; i++) {
        const off_t at = (off_t)(head->e_phoff + i * sizeof segment);
        if (pread(fd, &segment, sizeof segment, at) != (ssize_t)sizeof segment)
            return (traits){.has_linker = true}; /* not known */
        if (segment.p_type != PT_INTERP && segment.p_type != PT_NOTE)
            continue;
        const size_t size = read_segment(bytes, fd, &segment);
        if (segment.p_type == PT_NOTE)
            found.go = found.go || has_go_note(bytes, size);
        else
            found.musl = strstr(bytes, "ld-musl") != NULL;
        found.has_linker = found.has_linker || segment.p_type == PT_INTERP;
    }
    return found;
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
    const traits program = read_traits(fd, &head);
    if (!program.has_linker)
        return "it is linked statically";
    if (program.musl)
        return "it is made for another C library, musl";
    if (program.go)
        return "it is written in Go, which makes system calls without the C library";
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
