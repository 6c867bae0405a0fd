/* SPDX-License-Identifier: MIT
 *
 * table.c - the descriptors of a program that are CAN sockets, and those that it must not see.
 */
#include "preload/table.h"

#include "preload/hooks/real.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#define HIDDEN_FROM 700 /* below the usual limit of descriptors, 1024 */

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static sigset_t before; /* of the thread that holds it */
static cansock *table[TABLE_MAX];
static bool hidden[TABLE_MAX];
static bool closing[TABLE_MAX];     /* hidden ones that close when nobody holds them */
static unsigned holders[TABLE_MAX]; /* calls that use a hidden one without the lock */
static int highest = -1; /* descriptor that ever had an entry */
static pid_t owner;

void (*table_on_end)(cansock *s);

/* Signals wait meanwhile: their handlers may make the same calls. */
void table_lock(void)
{
    sigset_t all, mask;
    (void)sigfillset(&all);
    (void)pthread_sigmask(SIG_SETMASK, &all, &mask);
    (void)pthread_mutex_lock(&lock);
    before = mask;
}

void table_unlock(void)
{
    const sigset_t mask = before;
    (void)pthread_mutex_unlock(&lock);
    (void)pthread_sigmask(SIG_SETMASK, &mask, NULL);
}

bool table_is_own_process(void)
{
    return owner == 0 || owner == getpid();
}

static cansock *table_look(int fd)
{
    return fd >= 0 && fd < TABLE_MAX ? __atomic_load_n(&table[fd], __ATOMIC_ACQUIRE) : NULL;
}

static void table_put(int fd, cansock *s)
{
    __atomic_store_n(&table[fd], s, __ATOMIC_RELEASE);
    if (fd > highest)
        highest = fd;
}

bool table_is_hidden(int fd)
{
    return fd >= 0 && fd < TABLE_MAX && __atomic_load_n(&hidden[fd], __ATOMIC_RELAXED);
}

bool table_concerns(int fd)
{
    return (table_look(fd) || table_is_hidden(fd)) && table_is_own_process();
}

/* ---- Sockets --------------------------------------------------------------------------------- */

static ino_t inode_of(int fd)
{
    struct stat found;
    return fstat(fd, &found) == 0 ? found.st_ino : 0;
}

cansock *table_new(int fd, cansock_kind kind)
{
    cansock *s = fd < TABLE_MAX ? calloc(1, sizeof *s) : NULL;
    if (!s) {
        errno = fd < TABLE_MAX ? ENOMEM : EMFILE;
        return NULL;
    }
    if (owner == 0)
        owner = getpid();
    *s = (cansock){.kind = kind, .uses = 1, .descriptors = 1, .direct = -1};
    s->inode = inode_of(fd);
    s->raw.loopback = 1;
    for (int i = 0; i < IFMAP_MAX; i++)
        s->side[i] = -1;
    table_lock();
    table_forget(fd); /* an earlier one that was closed unseen */
    table_put(fd, s);
    table_unlock();
    return s;
}

void table_give_locked(cansock *s)
{
    if (--s->uses > 0)
        return;
    table_on_end(s);
    free(s->raw.filters);
    free(s);
}

/* Somebody may have closed the descriptor by a call that does not come here, and may have another
 * file there now. */
cansock *table_take(int fd)
{
    if (!table_look(fd))
        return NULL;
    const ino_t inode = inode_of(fd);
    table_lock();
    cansock *s = table_look(fd);
    if (s && s->inode == inode) {
        s->uses++;
    } else if (s) {
        if (table_is_own_process())
            table_forget(fd);
        s = NULL;
    }
    table_unlock();
    return s;
}

void table_give(cansock *s)
{
    table_lock();
    table_give_locked(s);
    table_unlock();
}

void table_add(int fd, cansock *s)
{
    if (fd < 0 || fd >= TABLE_MAX)
        return;
    table_lock();
    table_forget(fd);
    s->uses++;
    s->descriptors++;
    table_put(fd, s);
    table_unlock();
}

void table_forget(int fd)
{
    cansock *s = table_look(fd);
    if (!s)
        return;
    table_put(fd, NULL);
    watch_forget(&s->watches, fd);
    s->descriptors--;
    table_give_locked(s);
}

cansock *table_at(int fd)
{
    return table_look(fd);
}

int table_next(int fd)
{
    for (; fd <= highest; fd++)
        if (table_look(fd))
            return fd;
    return -1;
}

/* ---- Replacing ------------------------------------------------------------------------------- */

/* An option that the old socket does not have is left out. */
static void copy_option(int to, int from, int option)
{
    char value[sizeof(struct timespec)];
    socklen_t size = sizeof value;
    if (real()->getsockopt(from, SOL_SOCKET, option, value, &size) == 0)
        (void)real()->setsockopt(to, SOL_SOCKET, option, value, size);
}

void table_replace(cansock *s, int fd)
{
    bool first = true;
    for (int old = table_next(0); old >= 0; old = table_next(old + 1)) {
        if (table_look(old) != s)
            continue;
        if (first) {
            copy_option(fd, old, SO_RCVTIMEO);
            copy_option(fd, old, SO_SNDTIMEO);
            (void)real()->fcntl(fd, F_SETFL, real()->fcntl(old, F_GETFL));
        }
        const int flags = real()->fcntl(old, F_GETFD);
        watch_suspend(s->watches, old);
        (void)real()->dup3(fd, old, flags & FD_CLOEXEC ? O_CLOEXEC : 0);
        watch_resume(s->watches, old);
        first = false;
    }
    s->inode = inode_of(fd);
    (void)real()->close(fd);
}

/* ---- Hidden descriptors ---------------------------------------------------------------------- */

int table_hide(int fd)
{
    struct rlimit limit = {.rlim_cur = 0};
    if (fd < 0)
        return fd;
    (void)getrlimit(RLIMIT_NOFILE, &limit);
    const int from = limit.rlim_cur > HIDDEN_FROM ? HIDDEN_FROM : (int)limit.rlim_cur / 2;
    const int moved = real()->fcntl(fd, F_DUPFD_CLOEXEC, from);
    if (moved >= 0)
        (void)real()->close(fd);
    const int place = moved >= 0 ? moved : fd;
    if (place < TABLE_MAX)
        __atomic_store_n(&hidden[place], true, __ATOMIC_RELAXED);
    return place;
}

static bool is_held(int fd)
{
    return fd < TABLE_MAX && holders[fd] > 0;
}

void table_close_hidden(int fd)
{
    if (fd < 0)
        return;
    if (is_held(fd)) {
        closing[fd] = true;
        return;
    }
    if (fd < TABLE_MAX)
        __atomic_store_n(&hidden[fd], false, __ATOMIC_RELAXED);
    (void)real()->close(fd);
}

int table_hold(int fd)
{
    if (fd >= 0 && fd < TABLE_MAX)
        holders[fd]++;
    return fd;
}

void table_release(int fd)
{
    if (fd < 0 || !is_held(fd) || --holders[fd] > 0 || !closing[fd])
        return;
    closing[fd] = false;
    table_close_hidden(fd);
}

/* ---- Processes ------------------------------------------------------------------------------- */

void table_forked(void)
{
    owner = getpid();
    for (int fd = 0; fd <= highest; fd++)
        if (table[fd])
            table[fd]->shared = true;
    for (int fd = 0; fd < TABLE_MAX; fd++) { /* the threads that hold them are not here */
        holders[fd] = holders[fd] > 0;
        table_release(fd);
    }
}
