/* SPDX-License-Identifier: MIT
 *
 * port_rig.h - ports at sockets in a folder of their own, for unit tests.
 */
#ifndef CANWIRE_TEST_PORT_RIG_H
#define CANWIRE_TEST_PORT_RIG_H

#include "rig.h"

#include "port/open.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

typedef struct fixture {
    char folder[64];
    char path[80];
    char name[90]; /* of the port */
    port *port;
} fixture;

/* Makes the folder, and names the port. */
static inline fixture *make_fixture(void **state)
{
    fixture *f = calloc(1, sizeof *f);
    strcpy(f->folder, "/tmp/canwire-test-XXXXXX");
    assert_non_null(mkdtemp(f->folder));
    snprintf(f->path, sizeof f->path, "%s/ecu", f->folder);
    snprintf(f->name, sizeof f->name, "unix:%s", f->path);
    *state = f;
    return f;
}

static inline int set_up_port(void **state)
{
    char error[PORT_ERROR_TEXT_MAX];
    fixture *f = make_fixture(state);
    f->port = port_open(f->name, "bus", error);
    assert_non_null(f->port);
    return 0;
}

static inline int tear_down(void **state)
{
    fixture *f = *state;
    port_close(f->port);
    assert_int_equal(access(f->path, F_OK), -1);
    assert_int_equal(rmdir(f->folder), 0);
    free(f);
    return 0;
}

/* Connects to a port, with flags of socket(). */
static inline int connect_with(const char *path, int flags)
{
    const struct sockaddr_un none = {.sun_family = AF_UNIX};
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    strcpy(address.sun_path, path);
    int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | flags, 0);
    if (flags & SOCK_NONBLOCK) /* a program has a name, by which the port knows it again */
        assert_int_equal(bind(fd, (const struct sockaddr *)&none, sizeof none.sun_family), 0);
    assert_int_equal(connect(fd, (struct sockaddr *)&address, sizeof address), 0);
    return fd;
}

/* Reads all waiting frames, as an engine does at a wake-up. */
static inline unsigned read_all(port *p, port_frame *frames)
{
    unsigned count = 0;
    bool more = true;
    while (more) {
        port_frame batch[PORT_BATCH];
        unsigned some = port_read(p, batch, PORT_BATCH, &more);
        memcpy(frames + count, batch, some * sizeof *batch);
        count += some;
    }
    return count;
}

static inline port_stats stats_of(port *p)
{
    port_stats s;
    port_get_stats(p, &s);
    return s;
}

#endif
