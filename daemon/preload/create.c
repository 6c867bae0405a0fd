/* SPDX-License-Identifier: MIT
 *
 * create.c - the start and the end of CAN sockets, and of the library.
 */
#include "preload/create.h"

#include "preload/bcm.h"
#include "preload/conn.h"
#include "preload/pump.h"
#include "preload/raw.h"
#include "preload/hooks/real.h"
#include "preload/relay.h"
#include "preload/vtime.h"
#include "preload/vtimer.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <pthread.h>
#include <sys/socket.h>

static int create_fail(int error)
{
    errno = error;
    return -1;
}

/* Makes the entry of a real socket. */
static int create_keep(int fd, cansock_kind kind)
{
    cansock *s = fd >= 0 ? table_new(fd, kind) : NULL;
    if (s || fd < 0)
        return fd;
    const int error = errno;
    (void)real()->close(fd);
    return create_fail(error);
}

/* The program gets one end of a pair of sockets; the library has the other one. Returns -1 with
 * errno. */
static int create_bcm(int flags)
{
    const int fd = create_keep(real()->socket(AF_UNIX, SOCK_SEQPACKET | flags, 0), CANSOCK_BCM);
    cansock *s = fd >= 0 ? table_take(fd) : NULL;
    if (!s)
        return fd;
    const int error = bcm_make(s);
    table_give(s);
    if (!error)
        return fd;
    table_lock();
    table_forget(fd);
    table_unlock();
    (void)real()->close(fd);
    return create_fail(error);
}

int create_socket(int type, int protocol)
{
    const int flags = type & (SOCK_CLOEXEC | SOCK_NONBLOCK);
    type &= ~(SOCK_CLOEXEC | SOCK_NONBLOCK);
    if (protocol < 0 || protocol >= CAN_NPROTO)
        return create_fail(EINVAL);
    if (protocol != CAN_RAW && protocol != CAN_BCM)
        return create_fail(EPROTONOSUPPORT);
    if (type != (protocol == CAN_RAW ? SOCK_RAW : SOCK_DGRAM))
        return create_fail(EPROTOTYPE);
    if (protocol == CAN_BCM)
        return create_bcm(flags);
    return create_keep(conn_socket(flags), CANSOCK_RAW);
}

/* ---- The end --------------------------------------------------------------------------------- */

static void create_flush(cansock *s, int fd)
{
    if (s->bcm)
        bcm_stop(s);
    raw_flush(s, fd);
}

void create_close(int fd)
{
    cansock *s = table_take(fd);
    if (!s)
        return;
    if (s->descriptors == 1)
        create_flush(s, fd);
    table_lock();
    table_forget(fd);
    table_give_locked(s);
    table_unlock();
}

void create_exit(void)
{
    if (!table_is_own_process())
        return;
    for (int fd = table_next(0); fd >= 0; fd = table_next(fd + 1)) {
        cansock *s = table_take(fd);
        if (!s)
            continue;
        create_flush(s, fd);
        table_give(s);
    }
}

/* Frees what a CAN socket has, when its last user has given it back. */
static void create_end(cansock *s)
{
    relay_free(s);
    bcm_free(s);
    for (int i = 0; i < IFMAP_MAX; i++)
        table_close_hidden(s->side[i]);
}

/* ---- The library ----------------------------------------------------------------------------- */

/* The child has a thread of its own for items, and no turn yet. The lock was taken before the
 * fork. */
static void forked_child(void)
{
    table_forked();
    bcm_forked();
    pump_forked();
    table_unlock();
    vtimer_forked();
    vtime_fork_child();
}

static void forking(void)
{
    vtime_fork_prepare();
    table_lock();
}

static void forked_parent(void)
{
    table_unlock();
    vtime_fork_parent();
}

/* Runs before main(). The real calls come first: all others need them. */
static void __attribute__((constructor)) create_begin(void)
{
    real_find();
    ifmap_read();
    table_on_end = create_end;
    (void)pthread_atfork(forking, forked_parent, forked_child);
    vtime_begin();
}

static void __attribute__((destructor)) create_finish(void)
{
    create_exit();
}
