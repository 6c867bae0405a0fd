/* SPDX-License-Identifier: MIT
 *
 * hooks_socket.c - calls that make, bind and set up sockets.
 */
#include "preload/bcm.h"
#include "preload/create.h"
#include "preload/hooks/hook.h"
#include "preload/options.h"
#include "preload/raw.h"

#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>

#define ADDRESS_TOLD (offsetof(struct sockaddr_can, can_ifindex) + sizeof(int))

HOOK int socket(int domain, int type, int protocol)
{
    if (domain == PF_CAN && ifmap_count() > 0)
        return create_socket(type, protocol);
    return real()->socket(domain, type, protocol);
}

HOOK int bind(int fd, __CONST_SOCKADDR_ARG address, socklen_t size)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->bind(fd, address.__sockaddr__, size);
    const int error =
        s->kind == CANSOCK_RAW ? raw_bind(s, fd, address.__sockaddr__, size) : EOPNOTSUPP;
    table_give(s);
    return hook_result(error);
}

HOOK int connect(int fd, __CONST_SOCKADDR_ARG address, socklen_t size)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->connect(fd, address.__sockaddr__, size);
    const int error =
        s->kind == CANSOCK_BCM ? bcm_connect(s, address.__sockaddr__, size) : EOPNOTSUPP;
    table_give(s);
    return hook_result(error);
}

HOOK int shutdown(int fd, int how)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->shutdown(fd, how);
    table_give(s);
    return hook_result(EOPNOTSUPP);
}

HOOK int listen(int fd, int count)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->listen(fd, count);
    table_give(s);
    return hook_result(EOPNOTSUPP);
}

/* ---- Addresses ------------------------------------------------------------------------------- */

HOOK int getsockname(int fd, __SOCKADDR_ARG address, socklen_t *restrict size)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->getsockname(fd, address.__sockaddr__, size);
    const struct sockaddr_can name = {.can_family = AF_CAN, .can_ifindex = s->index};
    const bool has = s->kind == CANSOCK_RAW;
    table_give(s);
    if (!has)
        return hook_result(EOPNOTSUPP);
    memcpy(address.__sockaddr__, &name, *size < ADDRESS_TOLD ? *size : ADDRESS_TOLD);
    *size = ADDRESS_TOLD;
    return 0;
}

HOOK int getpeername(int fd, __SOCKADDR_ARG address, socklen_t *restrict size)
{
    cansock *s = table_take(fd);
    if (!s)
        return real()->getpeername(fd, address.__sockaddr__, size);
    table_give(s);
    return hook_result(EOPNOTSUPP);
}

/* ---- Options --------------------------------------------------------------------------------- */

HOOK int setsockopt(int fd, int level, int name, const void *value, socklen_t size)
{
    bool passes = true;
    cansock *s = table_take(fd);
    if (!s)
        return real()->setsockopt(fd, level, name, value, size);
    const int result = options_set(s, fd, level, name, value, size, &passes);
    table_give(s);
    return passes ? real()->setsockopt(fd, level, name, value, size) : result;
}

HOOK int getsockopt(int fd, int level, int name, void *restrict value, socklen_t *restrict size)
{
    bool passes = true;
    cansock *s = table_take(fd);
    if (!s)
        return real()->getsockopt(fd, level, name, value, size);
    const int result = options_get(s, level, name, value, size, &passes);
    table_give(s);
    return passes ? real()->getsockopt(fd, level, name, value, size) : result;
}

HOOK int epoll_ctl(int set, int operation, int fd, struct epoll_event *event)
{
    const int result = real()->epoll_ctl(set, operation, fd, event);
    cansock *s = result == 0 ? table_take(fd) : NULL;
    if (!s)
        return result;
    table_lock();
    watch_note(&s->watches, set, operation, fd, event);
    table_give_locked(s);
    table_unlock();
    return result;
}

/* ---- Interfaces ------------------------------------------------------------------------------ */

HOOK int ioctl(int fd, unsigned long request, ...)
{
    va_list more;
    int result;
    va_start(more, request);
    void *argument = va_arg(more, void *);
    va_end(more);
    cansock *s = table_take(fd);
    const bool own = s && interfaces_socket_ioctl(s, fd, request, argument, &result);
    if (s)
        table_give(s);
    if (own || interfaces_ioctl(request, argument, &result))
        return result;
    return real()->ioctl(fd, request, argument);
}

HOOK unsigned if_nametoindex(const char *name)
{
    const iface *in = ifmap_of_name(name);
    return in ? (unsigned)in->index : real()->if_nametoindex(name);
}

HOOK char *if_indextoname(unsigned index, char name[IF_NAMESIZE])
{
    const iface *in = ifmap_of_index((int)index);
    if (!in)
        return real()->if_indextoname(index, name);
    memcpy(name, in->names[0], sizeof in->names[0]);
    return name;
}

/* Adds ours to the list. if_freenameindex() frees it: each name, and the list. */
HOOK struct if_nameindex *if_nameindex(void)
{
    struct if_nameindex *list = real()->if_nameindex();
    size_t count = 0;
    while (list && list[count].if_index != 0)
        count++;
    struct if_nameindex *all =
        list ? realloc(list, (count + (size_t)ifmap_count() + 1) * sizeof *all) : NULL;
    if (!all)
        return list;
    for (int i = 0; i < ifmap_count(); i++) {
        all[count].if_index = (unsigned)ifmap_at(i)->index;
        all[count].if_name = strdup(ifmap_at(i)->names[0]);
        count += all[count].if_name != NULL;
    }
    all[count] = (struct if_nameindex){.if_index = 0};
    return all;
}
