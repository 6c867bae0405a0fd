/* SPDX-License-Identifier: MIT
 *
 * failing_heap.c - to be preloaded: while there is a file $FAIL with a number N, allocations are
 * counted, and number N fails and removes the file.
 *
 * Counted is what the program itself asks for, and in its name libc, libyaml, libev and jansson;
 * not what glib does, which ends a program that is out of memory.
 */
#define _GNU_SOURCE // dladdr
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <stdalign.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/auxv.h>
#include <unistd.h>

typedef void *allocate_many(size_t, size_t);
typedef void *reallocate(void *, size_t);
typedef void *allocate(size_t);
typedef void release(void *);

static allocate_many *real_calloc;
static reallocate *real_realloc;
static allocate *real_malloc;
static release *real_free;
static bool started;
static bool over; /* what counts the coverage at the end needs its memory */
static unsigned long count;
static __thread bool outside; /* what asserts in the C library that there is memory */

static bool counts(const void *caller)
{
    static const char *const libraries[] = {"/libc.so", "/libyaml", "/libev", "/libjansson"};
    Dl_info found;
    Dl_info program;
    if (dladdr(caller, &found) == 0)
        return false;
    if (dladdr((const void *)getauxval(AT_PHDR), &program) && found.dli_fbase == program.dli_fbase)
        return true;
    for (size_t i = 0; i < sizeof libraries / sizeof libraries[0]; i++)
        if (strstr(found.dli_fname, libraries[i]))
            return true;
    return false;
}

/* The number in the file, or 0 without one. */
static unsigned long wanted(const char *file)
{
    char text[24] = "";
    int in = file ? open(file, O_RDONLY | O_CLOEXEC) : -1;
    if (in < 0)
        return 0;
    if (read(in, text, sizeof text - 1) < 0)
        abort();
    close(in);
    return strtoul(text, NULL, 10);
}

static void end(void)
{
    over = true;
}

static bool fails(const void *caller)
{
    static bool will_end;
    const char *file = getenv("FAIL");
    if (!started || over || outside || !counts(caller))
        return false;
    if (!will_end && atexit(end) != 0)
        abort();
    will_end = true;
    unsigned long n = wanted(file);
    if (n == 0)
        count = 0;
    if (n == 0 || ++count != n)
        return false;
    if (unlink(file) != 0)
        abort();
    count = 0;
    errno = ENOMEM;
    return true;
}

/* ---- Before the program starts ----------------------------------------------------------------
 */

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

__attribute__((constructor)) static void start(void)
{
    real_calloc = (allocate_many *)dlsym(RTLD_NEXT, "calloc");
    real_realloc = (reallocate *)dlsym(RTLD_NEXT, "realloc");
    real_malloc = (allocate *)dlsym(RTLD_NEXT, "malloc");
    real_free = (release *)dlsym(RTLD_NEXT, "free");
    started = true;
}

/* ---- Functions that are replaced ---------------------------------------------------------------
 */

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
    return fails(__builtin_return_address(0)) ? NULL : real_malloc(size);
}

void *calloc(size_t n, size_t size)
{
    if (!started)
        return allocate_early(n * size); /* small numbers; zero, for it is not used again */
    return fails(__builtin_return_address(0)) ? NULL : real_calloc(n, size);
}

void *realloc(void *memory, size_t size)
{
    if (started && !is_early(memory))
        return fails(__builtin_return_address(0)) ? NULL : real_realloc(memory, size);
    void *now = started ? real_malloc(size) : allocate_early(size);
    size_t rest = memory ? (size_t)(early + sizeof early - (char *)memory) : 0;
    return now && memory ? memcpy(now, memory, size < rest ? size : rest) : now;
}

void free(void *memory)
{
    if (started && !is_early(memory))
        real_free(memory);
}
