/* SPDX-License-Identifier: MIT
 *
 * run.c - canwire run: runs a SocketCAN program at nodes of buses, where the kernel has no CAN.
 *
 * The program gets a library (daemon/preload) that stands before the calls of the C library, and a
 * variable that tells it the interfaces.
 */
#include "base/text/chars.h"

#include "base/text/plain.h"
#include "cli/client.h"
#include "cli/command.h"
#include "cli/run_nodes.h"

#include <elf.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <link.h>
#include <linux/can.h>
#include <net/if.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define VARIABLE "CANWIRE_SOCKETCAN"
#define VIRTUAL_VARIABLE "CANWIRE_VIRTUAL"
#define LIBRARY "libcanwire-socketcan.so"
#define LIBRARY_VARIABLE "CANWIRE_PRELOAD"
#define TEXT_MAX 8192
#define NOT_FOUND 127
#define NOT_RUNNABLE 126

static const char usage[] = "canwire run --bus BUS --as NODE [--interface NAME]... [--virtual] "
                            "[--] PROGRAM [ARGUMENT...]";

static const char help[] =
    "Runs a SocketCAN program where the kernel has no CAN. It sees the node as a CAN interface of\n"
    "that name. The node needs a port unix:PATH. Where the bus has guests, NODE may be a new\n"
    "name. BUS may also be the file of the configuration. Options can be repeated, for programs\n"
    "with several interfaces. canwire-run(7) says what programs can do, and which cannot be run.\n"
    "\n"
    "      --bus BUS          the bus of the nodes behind it\n"
    "      --as NODE          the node that the program is, or a guest of that name\n"
    "      --interface NAME   the name that the program uses, such as can0; default: that of the\n"
    "                         node\n"
    "      --virtual          the program has the time of the bus, which goes on while all such\n"
    "                         programs wait; the bus has 'pacing: virtual'\n";

typedef struct run_request {
    const char *bus; /* of the last option */
    run_node nodes[RUN_NODES_MAX];
    unsigned count;
    bool virtual_time;
} run_request;

/* ---- What does not fit ----------------------------------------------------------------------- */

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

/* Reads in an ELF file how a program is linked. Unreadable ones are taken for programs with a
 * dynamic linker, which can preload. */
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

/* Looks at a program, which execvp() will find, and prints a warning when the library is not for
 * it. Scripts and what cannot be read are left to execvp(). */
static void run_warn_of(const char *program)
{
    const int fd = open_found(program);
    const char *why = fd >= 0 ? why_not(fd) : NULL;
    if (fd >= 0)
        (void)close(fd);
    if (why)
        plain_print(stderr, "canwire run: %s will find no interfaces: %s; see canwire-run(7)\n",
                    program, why);
}

/* ---- Options --------------------------------------------------------------------------------- */

/* Takes a node of the bus that was named last. */
static bool take_node(void *out, const char *option, const char *text)
{
    run_request *r = out;
    if (!r->bus)
        plain_print(stderr, "canwire run: %s %s: --bus must stand before it\n", option, text);
    else if (r->count == RUN_NODES_MAX)
        plain_print(stderr, "canwire run: at most %d nodes\n", RUN_NODES_MAX);
    else
        r->nodes[r->count] = (run_node){.bus = r->bus, .name = text};
    return r->bus && r->count++ < RUN_NODES_MAX;
}

/* The name is for the node before it: options come in pairs. */
static bool take_interface(void *out, const char *option, const char *text)
{
    run_request *r = out;
    const char **name = r->count > 0 ? &r->nodes[r->count - 1].interface : NULL;
    if (!name)
        plain_print(stderr, "canwire run: %s %s: --as must stand before it\n", option, text);
    else if (*name)
        plain_print(stderr, "canwire run: %s %s: this node is %s already; --as comes first, for "
                            "each node\n", option, text, *name);
    if (!name || *name)
        return false;
    *name = text;
    return true;
}

/* ---- The library ----------------------------------------------------------------------------- */

/* Finds the library: named by the user, in the build beside this program, or installed. */
static bool find_library(char path[PATH_MAX])
{
    static const char *const places[] = {"/" LIBRARY, "/../lib/canwire/" LIBRARY};
    char own[PATH_MAX / 2];
    const char *named = getenv(LIBRARY_VARIABLE);
    if (named && *named)
        return snprintf(path, PATH_MAX, "%s", named) < PATH_MAX && access(path, R_OK) == 0;
    const ssize_t length = readlink("/proc/self/exe", own, sizeof own - 1);
    own[length > 0 ? length : 0] = '\0';
    char *slash = strrchr(own, '/');
    if (slash)
        *slash = '\0';
    for (size_t i = 0; slash && i < sizeof places / sizeof *places; i++) {
        (void)snprintf(path, PATH_MAX, "%s%s", own, places[i]);
        if (access(path, R_OK) == 0)
            return true;
    }
    return false;
}

/* The dynamic linker takes blanks and colons as ends of a path. */
static bool set_library(void)
{
    char path[PATH_MAX], all[2 * PATH_MAX];
    const char *before = getenv("LD_PRELOAD");
    if (!find_library(path)) {
        plain_print(stderr, "canwire run: " LIBRARY " is not found: " LIBRARY_VARIABLE
                            " names its path\n");
        return false;
    }
    if (strpbrk(path, " :\t\n")) {
        plain_print(stderr, "canwire run: %s: blanks and colons cannot be in this path\n", path);
        return false;
    }
    const bool more = before && *before;
    const int length =
        snprintf(all, sizeof all, "%s%s%s", path, more ? ":" : "", more ? before : "");
    return length > 0 && (size_t)length < sizeof all && setenv("LD_PRELOAD", all, 1) == 0;
}

/* ---- The interfaces -------------------------------------------------------------------------- */

static const char *interface_of(const run_node *n)
{
    return n->interface ? n->interface : n->name;
}

/* Checks the names that the program will see as interfaces. */
static bool has_good_names(const run_request *r)
{
    for (unsigned i = 0; i < r->count; i++) {
        const char *name = interface_of(&r->nodes[i]);
        if (!*name || strlen(name) >= IF_NAMESIZE || strpbrk(name, "/: \t\n,")) {
            plain_print(stderr,
                        "canwire run: '%s' cannot be the name of an interface, which has at most "
                        "%d characters and no '/', ':', ',' or blank: use --interface NAME\n",
                        name, IF_NAMESIZE - 1);
            return false;
        }
        for (unsigned k = 0; k < i; k++)
            if (strcmp(name, interface_of(&r->nodes[k])) == 0) {
                plain_print(stderr, "canwire run: two interfaces are called '%s': use --interface "
                                    "NAME\n", name);
                return false;
            }
    }
    return true;
}

/* Returns the node's own name where it can be a second name of its interface. */
static const char *second_name(const run_request *r, const run_node *n)
{
    bool good = n->interface && strcmp(n->interface, n->name) != 0 &&
                strlen(n->name) < IF_NAMESIZE && !strpbrk(n->name, "/: \t\n,");
    for (unsigned i = 0; i < r->count; i++)
        good = good && strcmp(n->name, interface_of(&r->nodes[i])) != 0;
    return good ? n->name : NULL;
}

/* Tells the library the interfaces; preload/ifmap.h has the format. */
static bool set_interfaces(const run_request *r)
{
    char text[TEXT_MAX];
    size_t used = 0;
    for (unsigned i = 0; i < r->count; i++) {
        const run_node *n = &r->nodes[i];
        const char *second = second_name(r, n);
        used = chars_print(text, sizeof text, used, "%s%s%s\t%u\t%s\t%s\t%s\n",
                           interface_of(n), second ? "," : "", second ? second : "",
                           n->fd ? (unsigned)CANFD_MTU : (unsigned)CAN_MTU,
                           n->guest ? "guest" : "node", n->name, n->path);
    }
    return used < sizeof text && setenv(VARIABLE, text, 1) == 0;
}

/* ---- Virtual time ---------------------------------------------------------------------------- */

static bool refuse_time(const run_node *n, const char *why)
{
    plain_print(stderr, "canwire run: --virtual: bus %s %s\n", n->bus, why);
    return false;
}

/* Tells the library the socket of time; preload/vtime.h has the format. */
static bool set_time(const run_request *r)
{
    char text[PATH_MAX];
    const run_node *n = &r->nodes[0];
    if (!r->virtual_time && *n->time)
        plain_print(stderr, "canwire run: warning: bus %s has virtual time, which goes on without "
                            "this program: --virtual lets it join\n", n->bus);
    if (!r->virtual_time)
        return unsetenv(VIRTUAL_VARIABLE) == 0;
    if (!*n->time)
        return refuse_time(n, "has real time: it needs 'pacing: virtual'");
    for (unsigned i = 1; i < r->count; i++)
        if (strcmp(r->nodes[i].time, n->time) != 0)
            return refuse_time(&r->nodes[i], "has another time than the first one");
    const int length =
        snprintf(text, sizeof text, "%d\t%s\t%s", (int)getpid(), n->name, n->time);
    return length > 0 && (size_t)length < sizeof text && setenv(VIRTUAL_VARIABLE, text, 1) == 0;
}

/* ---- Running --------------------------------------------------------------------------------- */

/* Becomes the program. It returns only when that cannot be run, with the exit status of a shell. */
static int run_program(char **arguments)
{
    (void)execvp(arguments[0], arguments);
    const int error = errno;
    plain_print(stderr, "canwire run: %s: %s\n", arguments[0], strerror(error));
    return error == ENOENT ? NOT_FOUND : NOT_RUNNABLE;
}

/* Finds socket and kind of each node at its bus. Returns false after a message. */
static bool find_nodes(run_request *r)
{
    for (unsigned i = 0; i < r->count; i++)
        if (!run_find_node(&r->nodes[i]))
            return false;
    return true;
}

int cli_run(int argc, char **argv)
{
    run_request r = {.count = 0};
    int first = 0;
    const command c = {.usage = usage,
                       .help = help,
                       .words_min = 1,
                       .words_max = -1,
                       .options_first = true,
                       .is_program = true,
                       .options = {{"bus", .text = &r.bus},
                                   {"as", .read = take_node, .out = &r},
                                   {"interface", .read = take_interface, .out = &r},
                                   {"virtual", .flag = &r.virtual_time}}};
    const int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    if (r.count == 0) {
        plain_print(stderr, "usage: %s\n", usage);
        return CLI_USAGE;
    }
    if (!has_good_names(&r) || !find_nodes(&r) || !set_interfaces(&r) || !set_time(&r) ||
        !set_library())
        return CLI_BAD_INPUT;
    run_warn_of(argv[first]);
    return run_program(argv + first);
}
