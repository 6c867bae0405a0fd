/* SPDX-License-Identifier: MIT
 *
 * test_port_gather.c - frames for a plain ECU and of it that go with one call of the kernel.
 */
#include "port_rig.h"

#include "port/port.h"

#include <dlfcn.h>
#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <sys/epoll.h>

#define MANY 100u

/* ---- The kernel, which may take less --------------------------------------------------------- */

static unsigned calls; /* of sendmmsg() */
static unsigned most;  /* messages that it takes in one call, 0: all */
static int refusal;    /* errno of these calls, 0: none */

int sendmmsg(int fd, struct mmsghdr *messages, unsigned count, int flags)
{
    static int (*real)(int, struct mmsghdr *, unsigned, int);
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "sendmmsg");
    calls++;
    errno = refusal;
    return refusal ? -1 : real(fd, messages, most && most < count ? most : count, flags);
}

static unsigned looks; /* calls of epoll_wait() */

int epoll_wait(int fd, struct epoll_event *events, int most_events, int timeout)
{
    static int (*real)(int, struct epoll_event *, int, int);
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "epoll_wait");
    looks++;
    return real(fd, events, most_events, timeout);
}

/* ---- Set-up ---------------------------------------------------------------------------------- */

typedef struct gathering {
    port *port;
    int ecu;
} gathering;

static int set_up_pair(void **state)
{
    gathering *f = calloc(1, sizeof *f);
    char name[20], error[PORT_ERROR_TEXT_MAX];
    int pair[2];
    assert_int_equal(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, pair), 0);
    (void)snprintf(name, sizeof name, "fd:%d", pair[0]);
    f->port = port_open(name, "bus", error);
    f->ecu = pair[1];
    assert_non_null(f->port);
    calls = most = 0;
    refusal = 0;
    *state = f;
    return 0;
}

static int tear_down_pair(void **state)
{
    gathering *f = *state;
    port_close(f->port);
    if (f->ecu >= 0)
        close(f->ecu);
    free(f);
    return 0;
}

static void write_numbered(port *p, unsigned first, unsigned count)
{
    for (unsigned i = first; i < first + count; i++) {
        const cw_frame frame = rig_frame(i, 0, 3);
        assert_true(port_write(p, &frame));
    }
}

/* The ECU writes some frames, and the port reads them all, with so many looks for them. */
static void assert_read(const gathering *f, unsigned count, unsigned expected_looks)
{
    const struct can_frame frame = {.can_id = 0x123, .len = 0};
    port_frame frames[PORT_BATCH];
    bool more;
    for (unsigned i = 0; i < count; i++)
        assert_int_equal(send(f->ecu, &frame, sizeof frame, 0), sizeof frame);
    looks = 0;
    assert_int_equal(port_read(f->port, frames, PORT_BATCH, &more), count);
    assert_int_equal(looks, expected_looks);
    assert_false(more);
}

static void assert_nothing_waits(int ecu)
{
    struct can_frame out;
    assert_int_equal(recv(ecu, &out, sizeof out, MSG_DONTWAIT), -1);
    assert_int_equal(errno, EAGAIN);
}

static void assert_numbered(int ecu, unsigned first, unsigned count)
{
    for (unsigned i = first; i < first + count; i++) {
        struct can_frame out;
        assert_int_equal(recv(ecu, &out, sizeof out, MSG_DONTWAIT), sizeof out);
        assert_int_equal(out.can_id, i);
    }
}

#define ON_PORT(test) TEST_WITH(test, set_up_pair, tear_down_pair)

/* ---- Tests ----------------------------------------------------------------------------------- */

ON_PORT(gathered_frames_go_in_one_call_in_order)
{
    gathering *f = *state;
    const errframe error = {.can_id = CAN_ERR_FLAG | CAN_ERR_BUSOFF};
    struct can_frame out;
    port_gather(f->port);
    write_numbered(f->port, 0x100, 3);
    assert_true(port_write_error(f->port, &error, 0));
    write_numbered(f->port, 0x103, 2);
    assert_nothing_waits(f->ecu);
    port_flush(f->port);
    assert_int_equal(calls, 1);
    assert_numbered(f->ecu, 0x100, 3);
    assert_int_equal(recv(f->ecu, &out, sizeof out, MSG_DONTWAIT), sizeof out);
    assert_int_equal(out.can_id, error.can_id);
    assert_numbered(f->ecu, 0x103, 2);
    assert_nothing_waits(f->ecu);
    assert_int_equal(stats_of(f->port).written, 5);
    assert_int_equal(stats_of(f->port).errors_written, 1);
    write_numbered(f->port, 0x200, 1); /* at once */
    assert_numbered(f->ecu, 0x200, 1);
}

ON_PORT(many_frames_do_not_wait_for_the_flush)
{
    gathering *f = *state;
    port_gather(f->port);
    write_numbered(f->port, 0, MANY);
    assert_int_equal(calls, MANY / 32);
    assert_numbered(f->ecu, 0, MANY / 32 * 32);
    assert_nothing_waits(f->ecu);
    port_flush(f->port);
    assert_numbered(f->ecu, MANY / 32 * 32, MANY % 32);
    assert_int_equal(stats_of(f->port).written, MANY);
}

ON_PORT(a_kernel_that_takes_some_or_none_loses_nothing)
{
    gathering *f = *state;
    port_gather(f->port);
    write_numbered(f->port, 0x100, 5);
    most = 2;
    port_flush(f->port);
    assert_numbered(f->ecu, 0x100, 5);
    refusal = EINTR;
    port_gather(f->port);
    write_numbered(f->port, 0x110, 5);
    port_flush(f->port);
    assert_numbered(f->ecu, 0x110, 5);
    assert_int_equal(calls, 2);
    assert_int_equal(stats_of(f->port).written, 10);
    assert_int_equal(stats_of(f->port).write_failed, 0);
}

ON_PORT(gathered_frames_without_room_count_as_failed)
{
    gathering *f = *state;
    const cw_frame frame = rig_frame(0x123, 0, 8);
    uint64_t room = 0;
    while (port_write(f->port, &frame))
        room++;
    assert_true(room >= 100);
    assert_numbered(f->ecu, 0x123, 1);
    port_gather(f->port);
    write_numbered(f->port, 0x100, 4);
    port_flush(f->port);
    assert_int_equal(stats_of(f->port).written, room + 1);
    assert_int_equal(stats_of(f->port).write_failed, 1 + 3);
}

ON_PORT(gathered_frames_for_an_ecu_that_has_gone_are_unheard)
{
    gathering *f = *state;
    port_gather(f->port);
    write_numbered(f->port, 0x100, 4);
    close(f->ecu);
    f->ecu = -1;
    port_flush(f->port);
    assert_int_equal(stats_of(f->port).unheard, 4);
    assert_int_equal(stats_of(f->port).written + stats_of(f->port).write_failed, 0);
}

ON_PORT(whoever_asks_for_counts_has_all_of_them)
{
    gathering *f = *state;
    port_gather(f->port);
    write_numbered(f->port, 0x100, 2);
    assert_int_equal(stats_of(f->port).written, 2);
    assert_numbered(f->ecu, 0x100, 2);
    write_numbered(f->port, 0x102, 1); /* it gathers on */
    assert_nothing_waits(f->ecu);
    port_flush(f->port);
    assert_numbered(f->ecu, 0x102, 1);
}

ON_PORT(frames_of_an_ecu_that_goes_on_come_in_one_call)
{
    gathering *f = *state;
    assert_read(f, 3, 1);
    assert_read(f, 2, 0);
    assert_read(f, 0, 0); /* so the next one asks first, which costs less */
    assert_read(f, 0, 1);
    assert_read(f, 1, 1);
    assert_read(f, 5, 0);
    assert_int_equal(stats_of(f->port).read, 11);
    assert_int_equal(stats_of(f->port).read_failed, 0);
}

ON_PORT(the_end_of_an_ecu_that_went_on_is_noticed)
{
    gathering *f = *state;
    const struct can_frame frame = {.can_id = 0x123, .len = 0};
    port_frame frames[PORT_BATCH];
    bool more;
    assert_read(f, 1, 1);
    assert_int_equal(send(f->ecu, &frame, sizeof frame, 0), sizeof frame);
    close(f->ecu);
    f->ecu = -1;
    assert_int_equal(port_read(f->port, frames, PORT_BATCH, &more), 1);
    assert_int_equal(port_read(f->port, frames, PORT_BATCH, &more), 0);
    assert_int_equal(stats_of(f->port).read, 2);
    const cw_frame out = rig_frame(0x100, 0, 0);
    assert_false(port_write(f->port, &out));
    assert_int_equal(stats_of(f->port).unheard, 1);
}
