/* SPDX-License-Identifier: MIT
 *
 * failing_calls.c - to be preloaded: calls of the C library that fail by order.
 *
 * The file $FAIL, which both sides map, begins with an order (struct order; tests/calls/failing.py
 * writes it). The order names the first call to fail and its errno, and says if all of its kind
 * fail from then on. The site of a call is the function with its callers. A call is known by its
 * site and its number there, since a number among all calls would change with threads and time. The
 * sites that were passed are listed behind the order.
 *
 * Calls of the program count, and those of libc, libyaml, libev, jansson and liblcm for it. Memory
 * of glib does not count: glib ends a program without memory. Calls inside of libc cannot be
 * replaced: a stream fails as a whole, with the errors of its file.
 */
#ifdef _FORTIFY_SOURCE
#undef _FORTIFY_SOURCE
#endif
#define _GNU_SOURCE // dladdr
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <grp.h>
#include <link.h>
#include <netdb.h>
#include <poll.h>
#include <pthread.h>
#include <stdalign.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/timerfd.h>
#include <unistd.h>
#include <unwind.h>

/* ---- Shared with tests/calls/failing.py ------------------------------------------------------ */

#define MAGIC 0x4641494Cu
#define FILE_BYTES (1u << 20)
#define NAME_BYTES 24
#define FRAMES 8u

enum kind { /* kinds of calls that fail together from then on */
            MEMORY = 1 << 0,
            DESCRIPTOR = 1 << 1, /* a new one */
            WRITE = 1 << 2,      /* a file */
            READ = 1 << 3,
            LOOK = 1 << 4, /* at what there is in the file system */
            SOCKET = 1 << 5,
            TRAFFIC = 1 << 6, /* through sockets and their like */
            WAKE = 1 << 7,
            THREAD = 1 << 8,
            TELL = 1 << 9, /* on standard error */
            CLOSE = 1 << 10,
            NUDGE = 1 << 11, /* timers, pipes and events, which wake a thread */
};

enum how { WITH_ERRNO, PARTLY };

struct order {
    uint32_t magic;
    uint32_t on;
    uint64_t site;
    uint64_t caller;  /* of the site */
    uint32_t number;  /* of the first to fail; 0: none */
    uint32_t lasting; /* and all of its kind from then on */
    uint32_t how;
    int32_t error;
    uint32_t list; /* sites are to be listed */
    /* The answer */
    uint32_t seen; /* calls at the site */
    uint32_t failed;
    uint32_t group; /* of the first that failed */
    uint32_t sites;
    uint32_t left_out; /* sites, for want of room */
};

struct site {
    uint64_t hash;
    uint64_t caller;
    uint32_t group;
    uint32_t count;
    char name[NAME_BYTES];
    uint64_t frames[FRAMES]; /* return addresses in the program, 0: no more */
};

#define SITES_MAX ((FILE_BYTES - sizeof(struct order)) / sizeof(struct site))

static struct order *order;
static struct site *sites;

/* ---- Who calls --------------------------------------------------------------------------------
 */

#define OBJECTS_MAX 64u

typedef struct object {
    uintptr_t base;
    uintptr_t first;
    uintptr_t end;
    bool program;
    bool counts; /* all of its calls */
    bool counts_but_memory;
} object;

static object objects[OBJECTS_MAX];
static unsigned object_count;

static bool has_name(const char *path, const char *const *names)
{
    for (; *names; names++)
        if (strstr(path, *names))
            return true;
    return false;
}

static int note_object(struct dl_phdr_info *info, size_t size, void *user)
{
    static const char *const libraries[] = {"/libc.so", "/libyaml", "/libev", "/libjansson", NULL};
    static const char *const others[] = {"/liblcm", NULL};
    (void)size;
    (void)user;
    if (object_count == OBJECTS_MAX)
        return 1;
    object o = {.base = info->dlpi_addr, .first = UINTPTR_MAX, .program = object_count == 0};
    for (unsigned i = 0; i < info->dlpi_phnum; i++) {
        const ElfW(Phdr) *h = &info->dlpi_phdr[i];
        if (h->p_type != PT_LOAD)
            continue;
        uintptr_t first = info->dlpi_addr + h->p_vaddr;
        o.first = first < o.first ? first : o.first;
        o.end = first + h->p_memsz > o.end ? first + h->p_memsz : o.end;
    }
    o.counts = o.program || has_name(info->dlpi_name, libraries);
    o.counts_but_memory = has_name(info->dlpi_name, others);
    objects[object_count++] = o;
    return 0;
}

static const object *object_of(uintptr_t address)
{
    for (unsigned i = 0; i < object_count; i++)
        if (address >= objects[i].first && address < objects[i].end)
            return &objects[i];
    return NULL;
}

static uint64_t place_of(const object *o, uintptr_t address)
{
    return address - o->base + ((uint64_t)(o - objects) << 56);
}

/* ---- Sites ------------------------------------------------------------------------------------
 */

typedef struct stack {
    uintptr_t caller;
    bool found;
    bool foreign; /* another library has asked libc */
    unsigned count;
    uint64_t frames[FRAMES];
} stack;

static _Unwind_Reason_Code note_frame(struct _Unwind_Context *context, void *user)
{
    stack *s = user;
    uintptr_t address = _Unwind_GetIP(context);
    s->found = s->found || address == s->caller;
    const object *o = s->found ? object_of(address) : NULL;
    if (o && o->program)
        s->frames[s->count++] = place_of(o, address);
    else if (s->found && s->count == 0)
        s->foreign = s->foreign || !o || !o->counts;
    return s->count < FRAMES ? _URC_NO_REASON : _URC_END_OF_STACK;
}

static uint64_t mix(uint64_t hash, uint64_t word)
{
    return (hash ^ word) * UINT64_C(0x9E3779B97F4A7C15) + (hash >> 29);
}

static uint64_t hash_of(const char *name, uint64_t caller, const stack *s)
{
    uint64_t hash = mix(caller, 1);
    for (; *name; name++)
        hash = mix(hash, (unsigned char)*name);
    for (unsigned i = 0; i < s->count; i++)
        hash = mix(hash, s->frames[i]);
    return hash ? hash : 1;
}

static atomic_flag busy = ATOMIC_FLAG_INIT;

static void list_site(const char *name, unsigned group, uint64_t caller, uint64_t hash,
                      const stack *s)
{
    for (unsigned i = 0; i < order->sites; i++)
        if (sites[i].hash == hash) {
            sites[i].count++;
            return;
        }
    if (order->sites == SITES_MAX) {
        order->left_out++;
        return;
    }
    struct site *new = &sites[order->sites++];
    *new = (struct site){.hash = hash, .caller = caller, .group = group, .count = 1};
    strncpy(new->name, name, NAME_BYTES - 1);
    memcpy(new->frames, s->frames, sizeof new->frames);
}

/* ---- Whether a call fails ---------------------------------------------------------------------
 */

typedef enum outcome { GOOD, BAD, PART } outcome;

static bool started;
static bool over;             /* the program has ended; the count of the coverage needs its
                                 memory */
static __thread bool outside; /* in a function of the C library that asserts its memory */

static void end(void)
{
    over = true;
}

/* Its number has come, or an earlier one of the kind has failed. With the lock held. */
static bool is_turn(unsigned group, bool is_site)
{
    if (order->failed > 0)
        return order->lasting && order->group == group;
    if (!is_site || ++order->seen != order->number)
        return false;
    order->group = group;
    return true;
}

static outcome decide(const char *name, unsigned group, const void *caller)
{
    uintptr_t address = (uintptr_t)caller;
    const object *o = object_of(address);
    if (!o || !(o->counts || (o->counts_but_memory && group != MEMORY)))
        return GOOD;
    uint64_t place = place_of(o, address);
    stack s = {.caller = address};
    uint64_t hash = 0;
    if (order->list || order->caller == place || (group == MEMORY && !o->program)) {
        (void)_Unwind_Backtrace(note_frame, &s);
        hash = hash_of(name, place, &s);
    }
    if (group == MEMORY && s.foreign)
        return GOOD;
    bool is_site = order->site == hash;
    while (atomic_flag_test_and_set(&busy))
        continue;
    if (order->list)
        list_site(name, group, place, hash, &s);
    bool turn = is_turn(group, is_site);
    order->failed += turn;
    atomic_flag_clear(&busy);
    return !turn ? GOOD : order->how == PARTLY ? PART : BAD;
}

static outcome ask(const char *name, unsigned group, const void *caller)
{
    static bool will_end;
    if (!started || over || outside || !order || !order->on || group == 0)
        return GOOD;
    outside = true; /* of what is asked for here */
    if (!will_end && atexit(end) != 0)
        abort();
    will_end = true;
    int before = errno;
    outcome result = decide(name, group, caller);
    outside = false;
    errno = result == BAD ? order->error : before;
    return result;
}

/* ---- Before the program starts ----------------------------------------------------------------
 */

typedef void *allocate_many(size_t, size_t);
typedef void *reallocate(void *, size_t);
typedef void *allocate(size_t);
typedef void release(void *);

static allocate_many *real_calloc;
static reallocate *real_realloc;
static allocate *real_malloc;
static release *real_free;

/* Its libraries, and AddressSanitizer where that is in it, look for functions: that allocates. */
static alignas(max_align_t) char early[1 << 20];
static size_t early_used;

static bool is_early(const void *memory)
{
    return (const char *)memory >= early && (const char *)memory < early + sizeof early;
}

static void *allocate_early(size_t size)
{
    char *memory = early + early_used;
    early_used += (size + sizeof(max_align_t) - 1) / sizeof(max_align_t) * sizeof(max_align_t);
    return early_used <= sizeof early ? memory : NULL;
}

/* Looks a function up once. */
static void *find(void **found, const char *name)
{
    if (!*found)
        *found = dlsym(RTLD_NEXT, name);
    if (!*found)
        abort();
    return *found;
}

typedef int open_function(const char *, int, ...);

/* Takes the order; without one no call fails. */
static void take_order(void)
{
    static void *found;
    const char *file = getenv("FAIL");
    if (!file)
        return;
    int fd = ((open_function *)find(&found, "open"))(file, O_RDWR | O_CLOEXEC);
    void *memory =
        fd < 0 ? MAP_FAILED : mmap(NULL, FILE_BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (memory == MAP_FAILED)
        abort();
    (void)((int (*)(int))dlsym(RTLD_NEXT, "close"))(fd);
    order = memory;
    sites = (struct site *)(order + 1);
    if (order->magic != MAGIC)
        abort();
}

__attribute__((constructor)) static void start(void)
{
    real_calloc = (allocate_many *)dlsym(RTLD_NEXT, "calloc");
    real_realloc = (reallocate *)dlsym(RTLD_NEXT, "realloc");
    real_malloc = (allocate *)dlsym(RTLD_NEXT, "malloc");
    real_free = (release *)dlsym(RTLD_NEXT, "free");
    (void)dl_iterate_phdr(note_object, NULL);
    take_order();
    started = true;
}

/* ---- Memory ------------------------------------------------------------------------------------
 */

#define CALLER __builtin_return_address(0)

struct group *getgrnam(const char *name)
{
    struct group *(*real)(const char *) =
        (struct group * (*)(const char *)) dlsym(RTLD_NEXT, "getgrnam");
    outside = true;
    struct group *found = real(name);
    outside = false;
    return found;
}

void *malloc(size_t size)
{
    if (!started)
        return allocate_early(size);
    return ask("malloc", MEMORY, CALLER) ? NULL : real_malloc(size);
}

void *calloc(size_t n, size_t size)
{
    if (!started)
        return allocate_early(n * size); /* small numbers; zero, for it is not used again */
    return ask("calloc", MEMORY, CALLER) ? NULL : real_calloc(n, size);
}

void *realloc(void *memory, size_t size)
{
    if (started && !is_early(memory))
        return ask("realloc", MEMORY, CALLER) ? NULL : real_realloc(memory, size);
    void *now = started ? real_malloc(size) : allocate_early(size);
    size_t rest = memory ? (size_t)(early + sizeof early - (char *)memory) : 0;
    return now && memory ? memcpy(now, memory, size < rest ? size : rest) : now;
}

void free(void *memory)
{
    if (started && !is_early(memory))
        real_free(memory);
}

/* ---- Calls that fail as a whole ----------------------------------------------------------------
 */

/* CALL(group, type, what it returns when it fails, name, parameters, arguments) */
#define CALL(group, type, bad, name, parameters, arguments)                                        \
    type name parameters                                                                           \
    {                                                                                              \
        static void *found;                                                                        \
        type(*real) parameters = (type(*) parameters)find(&found, #name);                          \
        return ask(#name, group, CALLER) ? bad : real arguments;                                   \
    }

CALL(DESCRIPTOR, int, -1, socket, (int domain, int type, int protocol), (domain, type, protocol))
CALL(DESCRIPTOR, int, -1, accept4, (int fd, struct sockaddr *a, socklen_t *n, int f), (fd, a, n, f))
CALL(DESCRIPTOR, int, -1, epoll_create1, (int flags), (flags))
CALL(DESCRIPTOR, int, -1, timerfd_create, (int clock, int flags), (clock, flags))
CALL(DESCRIPTOR, int, -1, eventfd, (unsigned count, int flags), (count, flags))
CALL(DESCRIPTOR, int, -1, pipe, (int fds[2]), (fds))
CALL(DESCRIPTOR, int, -1, pipe2, (int fds[2], int flags), (fds, flags))
CALL(DESCRIPTOR, int, -1, dup, (int fd), (fd))
CALL(DESCRIPTOR, int, -1, socketpair, (int domain, int type, int protocol, int ends[2]),
     (domain, type, protocol, ends))
CALL(DESCRIPTOR, FILE *, NULL, fopen, (const char *name, const char *mode), (name, mode))
CALL(DESCRIPTOR, FILE *, NULL, fdopen, (int fd, const char *mode), (fd, mode))

CALL(SOCKET, int, -1, bind, (int fd, const struct sockaddr *a, socklen_t n), (fd, a, n))
CALL(SOCKET, int, -1, listen, (int fd, int backlog), (fd, backlog))
CALL(SOCKET, int, -1, connect, (int fd, const struct sockaddr *a, socklen_t n), (fd, a, n))
CALL(SOCKET, int, -1, shutdown, (int fd, int how), (fd, how))
CALL(SOCKET, int, -1, setsockopt, (int fd, int level, int name, const void *v, socklen_t n),
     (fd, level, name, v, n))
CALL(SOCKET, int, -1, getsockopt, (int fd, int level, int name, void *v, socklen_t *n),
     (fd, level, name, v, n))
CALL(SOCKET, int, -1, getpeername, (int fd, struct sockaddr *a, socklen_t *n), (fd, a, n))
CALL(SOCKET, int, -1, getsockname, (int fd, struct sockaddr *a, socklen_t *n), (fd, a, n))
CALL(SOCKET, int, EAI_MEMORY, getaddrinfo,
     (const char *node, const char *service, const struct addrinfo *hints, struct addrinfo **list),
     (node, service, hints, list))

CALL(TRAFFIC, ssize_t, -1, recvmsg, (int fd, struct msghdr *message, int flags),
     (fd, message, flags))
CALL(TRAFFIC, ssize_t, -1, sendmsg, (int fd, const struct msghdr *message, int flags),
     (fd, message, flags))
CALL(TRAFFIC, ssize_t, -1, sendto,
     (int fd, const void *data, size_t size, int flags, const struct sockaddr *a, socklen_t n),
     (fd, data, size, flags, a, n))

CALL(WAKE, int, -1, epoll_ctl, (int set, int what, int fd, struct epoll_event *event),
     (set, what, fd, event))
CALL(WAKE, int, -1, epoll_wait, (int set, struct epoll_event *events, int count, int timeout),
     (set, events, count, timeout))
CALL(WAKE, int, -1, poll, (struct pollfd * fds, nfds_t count, int timeout), (fds, count, timeout))
CALL(WAKE, int, -1, timerfd_settime,
     (int fd, int flags, const struct itimerspec *at, struct itimerspec *before),
     (fd, flags, at, before))

CALL(THREAD, pid_t, -1, fork, (void), ())

CALL(LOOK, int, -1, stat, (const char *name, struct stat *out), (name, out))
CALL(LOOK, int, -1, lstat, (const char *name, struct stat *out), (name, out))
CALL(LOOK, int, -1, fstat, (int fd, struct stat *out), (fd, out))
CALL(LOOK, int, -1, fstatat, (int at, const char *name, struct stat *out, int flags),
     (at, name, out, flags))
CALL(LOOK, int, -1, access, (const char *name, int mode), (name, mode))
CALL(LOOK, char *, NULL, realpath, (const char *name, char *out), (name, out))
CALL(LOOK, int, GLOB_NOSPACE, glob,
     (const char *text, int flags, int (*error)(const char *, int), glob_t *out),
     (text, flags, error, out))

CALL(WRITE, int, -1, rename, (const char *from, const char *to), (from, to))
CALL(WRITE, int, -1, renameat, (int a, const char *from, int b, const char *to), (a, from, b, to))
CALL(WRITE, int, -1, unlink, (const char *name), (name))
CALL(WRITE, int, -1, unlinkat, (int at, const char *name, int flags), (at, name, flags))
CALL(WRITE, int, -1, linkat, (int a, const char *from, int b, const char *to, int flags),
     (a, from, b, to, flags))
CALL(WRITE, int, -1, ftruncate, (int fd, off_t size), (fd, size))
CALL(WRITE, int, -1, fsync, (int fd), (fd))
CALL(WRITE, int, -1, fdatasync, (int fd), (fd))
CALL(WRITE, int, -1, chown, (const char *name, uid_t user, gid_t group), (name, user, group))
CALL(WRITE, int, -1, lchown, (const char *name, uid_t user, gid_t group), (name, user, group))
CALL(WRITE, int, -1, fchown, (int fd, uid_t user, gid_t group), (fd, user, group))
CALL(WRITE, int, -1, fchownat, (int at, const char *name, uid_t user, gid_t group, int flags),
     (at, name, user, group, flags))
CALL(WRITE, int, -1, fchmod, (int fd, mode_t mode), (fd, mode))
CALL(WRITE, int, -1, flock, (int fd, int how), (fd, how))

/* Returns its errno. */
CALL(THREAD, int, order->error, pthread_create,
     (pthread_t * thread, const pthread_attr_t *attributes, void *(*run)(void *), void *argument),
     (thread, attributes, run, argument))

/* CALL_VARIED(…, how the rest looks): with an argument that may be missing. */
#define CALL_VARIED(group, name, parameters, last, type, arguments)                                \
    int name parameters                                                                            \
    {                                                                                              \
        static void *found;                                                                        \
        va_list rest;                                                                              \
        va_start(rest, last);                                                                      \
        type value = va_arg(rest, type);                                                           \
        va_end(rest);                                                                              \
        int(*real) parameters = (int(*) parameters)find(&found, #name);                            \
        return ask(#name, group, CALLER) ? -1 : real arguments;                                    \
    }

CALL_VARIED(DESCRIPTOR, open, (const char *name, int flags, ...), flags, mode_t,
            (name, flags, value))
CALL_VARIED(DESCRIPTOR, openat, (int at, const char *name, int flags, ...), flags, mode_t,
            (at, name, flags, value))
CALL_VARIED(SOCKET, fcntl, (int fd, int what, ...), what, void *, (fd, what, value))
CALL_VARIED(SOCKET, ioctl, (int fd, unsigned long what, ...), what, void *, (fd, what, value))

/* ---- Calls that may be done in part ------------------------------------------------------------
 */

typedef int stat_function(int, struct stat *);
typedef int option_function(int, int, int, void *, socklen_t *);

static unsigned kind_of(int fd, unsigned of_file)
{
    static void *found;
    struct stat own = {.st_mode = 0};
    int before = errno;
    (void)((stat_function *)find(&found, "fstat"))(fd, &own);
    errno = before;
    return fd == 2                           ? TELL
           : S_ISREG(own.st_mode) || fd == 1 ? of_file
           : S_ISSOCK(own.st_mode)           ? TRAFFIC
                                             : NUDGE;
}

/* Returns true for a stream; messages of other sockets are whole. */
static bool has_parts(int fd)
{
    static void *found;
    int type = SOCK_STREAM;
    socklen_t size = sizeof type;
    int before = errno;
    (void)((option_function *)find(&found, "getsockopt"))(fd, SOL_SOCKET, SO_TYPE, &type, &size);
    errno = before;
    return type == SOCK_STREAM;
}

/* Breaks a connection for all calls, and for the other side. */
static void lose(int fd)
{
    static void *found;
    if (order->error == EPIPE || order->error == ECONNRESET)
        (void)((int (*)(int, int))find(&found, "shutdown"))(fd, SHUT_RDWR);
    errno = order->error;
}

#define TRANSFER(group, name, data_type, more, arguments)                                          \
    ssize_t name(int fd, data_type data, size_t size more)                                         \
    {                                                                                              \
        static void *found;                                                                        \
        ssize_t (*real)(int, data_type, size_t more) =                                             \
            (ssize_t(*)(int, data_type, size_t more))find(&found, #name);                          \
        outcome result = ask(#name, group, CALLER);                                                \
        if (result == PART && size > 1 && has_parts(fd))                                           \
            size = 1;                                                                              \
        if (result == BAD)                                                                         \
            lose(fd);                                                                              \
        return result == BAD ? -1 : real arguments;                                                \
    }
#define AND ,

TRANSFER(kind_of(fd, READ), read, void *, , (fd, data, size))
TRANSFER(kind_of(fd, WRITE), write, const void *, , (fd, data, size))
TRANSFER(TRAFFIC, recv, void *, AND int flags, (fd, data, size, flags))
TRANSFER(TRAFFIC, send, const void *, AND int flags, (fd, data, size, flags))
TRANSFER(READ, pread, void *, AND off_t at, (fd, data, size, at))
TRANSFER(WRITE, pwrite, const void *, AND off_t at, (fd, data, size, at))

int recvmmsg(int fd, struct mmsghdr *messages, unsigned count, int flags, struct timespec *until)
{
    static void *found;
    int (*real)(int, struct mmsghdr *, unsigned, int, struct timespec *) =
        (int (*)(int, struct mmsghdr *, unsigned, int, struct timespec *))find(&found, "recvmmsg");
    outcome result = ask("recvmmsg", TRAFFIC, CALLER);
    if (result == BAD)
        lose(fd);
    return result == BAD ? -1 : real(fd, messages, result == PART ? 1 : count, flags, until);
}

int sendmmsg(int fd, struct mmsghdr *messages, unsigned count, int flags)
{
    static void *found;
    int (*real)(int, struct mmsghdr *, unsigned, int) =
        (int (*)(int, struct mmsghdr *, unsigned, int))find(&found, "sendmmsg");
    outcome result = ask("sendmmsg", TRAFFIC, CALLER);
    if (result == BAD)
        lose(fd);
    return result == BAD ? -1 : real(fd, messages, result == PART ? 1 : count, flags);
}

/* Fails, but closes the descriptor in any case. */
int close(int fd)
{
    static void *found;
    outcome result = ask("close", CLOSE, CALLER);
    int closed = ((int (*)(int))find(&found, "close"))(fd);
    if (result != BAD)
        return closed;
    errno = order->error;
    return -1;
}

/* ---- Streams -----------------------------------------------------------------------------------
 */

/* Streams in memory fail with their memory; all streams together, which NULL is, do not. */
static unsigned group_of(FILE *stream, unsigned group)
{
    int fd = stream ? fileno(stream) : -1;
    return fd < 0 ? 0 : fd == 2 ? (unsigned)TELL : group;
}

static bool stream_fails(const char *name, FILE *stream, unsigned group, const void *caller)
{
    int before = errno;
    group = group_of(stream, group);
    errno = before;
    if (ask(name, group, caller) == GOOD)
        return false;
    stream->_flags |= _IO_ERR_SEEN;
    return true;
}

#define STREAM(group, type, bad, name, stream, parameters, arguments)                              \
    type name parameters                                                                           \
    {                                                                                              \
        static void *found;                                                                        \
        type(*real) parameters = (type(*) parameters)find(&found, #name);                          \
        return stream_fails(#name, stream, group, CALLER) ? bad : real arguments;                  \
    }

STREAM(READ, size_t, 0, fread, in, (void *to, size_t size, size_t n, FILE *in), (to, size, n, in))
STREAM(READ, char *, NULL, fgets, in, (char *to, int size, FILE *in), (to, size, in))
STREAM(READ, ssize_t, -1, getline, in, (char **to, size_t *size, FILE *in), (to, size, in))
STREAM(READ, ssize_t, -1, __getdelim, in, (char **to, size_t *size, int c, FILE *in),
       (to, size, c, in))
STREAM(READ, int, EOF, fgetc, in, (FILE * in), (in))
STREAM(READ, int, EOF, getc, in, (FILE * in), (in))

STREAM(WRITE, size_t, 0, fwrite, out, (const void *from, size_t size, size_t n, FILE *out),
       (from, size, n, out))
STREAM(WRITE, int, EOF, fputs, out, (const char *text, FILE *out), (text, out))
STREAM(WRITE, int, EOF, fputc, out, (int c, FILE *out), (c, out))
STREAM(WRITE, int, EOF, putc, out, (int c, FILE *out), (c, out))
STREAM(WRITE, int, EOF, puts, stdout, (const char *text), (text))
STREAM(WRITE, int, EOF, putchar, stdout, (int c), (c))
STREAM(WRITE, int, EOF, fflush, out, (FILE * out), (out))
STREAM(WRITE, int, -1, vfprintf, out, (FILE * out, const char *format, va_list list),
       (out, format, list))
STREAM(WRITE, int, -1, __vfprintf_chk, out,
       (FILE * out, int flag, const char *format, va_list list), (out, flag, format, list))

#define PRINT(name, stream, parameters, first)                                                     \
    int name parameters                                                                            \
    {                                                                                              \
        static void *found;                                                                        \
        va_list list;                                                                              \
        if (stream_fails(#name, stream, WRITE, CALLER))                                            \
            return -1;                                                                             \
        va_start(list, first);                                                                     \
        int result = ((int (*)(FILE *, const char *, va_list))find(&found, "vfprintf"))(           \
            stream, first, list);                                                                  \
        va_end(list);                                                                              \
        return result;                                                                             \
    }

PRINT(fprintf, out, (FILE * out, const char *format, ...), format)
PRINT(printf, stdout, (const char *format, ...), format)
PRINT(__fprintf_chk, out, (FILE * out, __attribute__((unused)) int flag, const char *format, ...),
      format)
PRINT(__printf_chk, stdout, (__attribute__((unused)) int flag, const char *format, ...), format)

/* Fails in the same way as close(). */
int fclose(FILE *stream)
{
    static void *found;
    int before = errno;
    unsigned group = group_of(stream, WRITE);
    errno = before;
    outcome result = ask("fclose", group, CALLER);
    int closed = ((int (*)(FILE *))find(&found, "fclose"))(stream);
    if (result != BAD)
        return closed;
    errno = order->error;
    return EOF;
}
