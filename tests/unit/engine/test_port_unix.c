/* SPDX-License-Identifier: MIT
 *
 * test_port_unix.c - names of ports, ports on Unix sockets, and the engine on them.
 */
#include "port_rig.h"

#include "config/node/portname.h"
#include "engine/engine.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <poll.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>

#define WAIT_MS 10000 /* for what has to come */
#define CLOCKS_NS 500000 /* that two clocks may be read apart */

/* ---- What the kernel refuses ----------------------------------------------------------------- */

static int refusal; /* errno of the next reads, 0: none */

int recvmmsg(int fd, struct mmsghdr *messages, unsigned count, int flags, struct timespec *timeout)
{
    static int (*real)(int, struct mmsghdr *, unsigned, int, struct timespec *);
    if (!real)
        *(void **)&real = dlsym(RTLD_NEXT, "recvmmsg");
    errno = refusal;
    return refusal ? -1 : real(fd, messages, count, flags, timeout);
}

/* ---- Set-up ---------------------------------------------------------------------------------- */

static struct can_frame raw_frame(uint32_t id, unsigned length)
{
    struct can_frame f = {.can_id = id, .len = (uint8_t)length};
    for (unsigned i = 0; i < length && i < 8; i++)
        f.data[i] = (uint8_t)(0x11 * (i + 1));
    return f;
}

static void write_raw(int fd, uint32_t id)
{
    const struct can_frame f = raw_frame(id, 2);
    assert_int_equal(send(fd, &f, sizeof f, MSG_NOSIGNAL), sizeof f);
}

static bool readable(int fd, int wait_ms)
{
    struct pollfd p = {.fd = fd, .events = POLLIN};
    return poll(&p, 1, wait_ms) == 1;
}

static unsigned read_none(port *p)
{
    port_frame frames[PORT_BATCH];
    return read_all(p, frames);
}

/* ---- Calls of the kernel --------------------------------------------------------------------- */

static unsigned accepts;

/* Replaces libc's function and counts the calls of the port. */
int accept4(int fd, struct sockaddr *address, socklen_t *size, int flags)
{
    accepts++;
    return (int)syscall(SYS_accept4, fd, address, size, flags);
}

#define ON_PORT(test) TEST_WITH(test, set_up_port, tear_down)

ON_PORT(a_port_at_which_nothing_waits_accepts_nothing)
{
    fixture *f = *state;
    accepts = 0;
    for (unsigned i = 0; i < 10; i++)
        assert_int_equal(read_none(f->port), 0);
    assert_int_equal(accepts, 0);
    int ecu = connect_with(f->path, 0);
    for (unsigned i = 0; i < 10; i++)
        assert_int_equal(read_none(f->port), 0);
    assert_int_equal(stats_of(f->port).connected, 1);
    assert_true(accepts >= 1 && accepts <= 2);
    accepts = 0;
    for (unsigned i = 0; i < 10; i++) {
        write_raw(ecu, 0x100 + i);
        assert_int_equal(read_none(f->port), 1);
        assert_int_equal(read_none(f->port), 0);
    }
    assert_int_equal(accepts, 0);
    int second = connect_with(f->path, 0);
    assert_int_equal(read_none(f->port), 0);
    assert_int_equal(stats_of(f->port).refused, 1);
    assert_true(accepts > 0);
    close(second);
    close(ecu);
}

/* ---- Names ----------------------------------------------------------------------------------- */

typedef struct name_case {
    const char *text;
    portname_kind kind;
    const char *path;
    int fd;
} name_case;

TEST(names_tell_the_kind_of_a_port)
{
    static const name_case cases[] = {
        {"vcan0", PORTNAME_INTERFACE, NULL, -1},
        {"unix", PORTNAME_INTERFACE, NULL, -1},
        {"fifteen-bytes-x", PORTNAME_INTERFACE, NULL, -1},
        {"sixteen-bytes-xx", PORTNAME_INVALID, NULL, -1},
        {"", PORTNAME_INVALID, NULL, -1},
        {".", PORTNAME_INVALID, NULL, -1},
        {"a b", PORTNAME_INVALID, NULL, -1},
        {"udp:1", PORTNAME_INVALID, NULL, -1},
        {"tcp:1", PORTNAME_TCP, NULL, -1},
        {"tcp:0", PORTNAME_INVALID, NULL, -1},
        {"unix:/run/a b", PORTNAME_UNIX, "/run/a b", -1},
        {"unix:relative", PORTNAME_UNIX, "relative", -1},
        {"unix:", PORTNAME_INVALID, "", -1},
        {"unix:a\nb", PORTNAME_INVALID, "a\nb", -1},
        {"fd:3", PORTNAME_FD, NULL, 3},
        {"fd:999999", PORTNAME_FD, NULL, 999999},
        {"fd:0", PORTNAME_INVALID, NULL, -1},
        {"fd:2", PORTNAME_INVALID, NULL, 2},
        {"fd:03", PORTNAME_INVALID, NULL, -1},
        {"fd:3x", PORTNAME_INVALID, NULL, -1},
        {"fd:-3", PORTNAME_INVALID, NULL, -1},
        {"fd:1000000", PORTNAME_INVALID, NULL, -1},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        portname name = portname_parse(cases[i].text);
        assert_int_equal(name.kind, cases[i].kind);
        assert_int_equal(portname_is_interface(cases[i].text),
                         cases[i].kind == PORTNAME_INTERFACE);
        if (name.kind == PORTNAME_UNIX)
            assert_string_equal(name.path, cases[i].path);
        if (name.kind == PORTNAME_FD)
            assert_int_equal(name.fd, cases[i].fd);
    }
    assert_false(portname_is_interface(NULL));
}

/* ---- Frames ---------------------------------------------------------------------------------- */

ON_PORT(frames_come_with_the_time_at_which_they_were_sent)
{
    fixture *f = *state;
    port_frame frames[PORT_BATCH];
    struct timespec before, after;
    int ecu = connect_with(f->path, 0);
    assert_int_equal(read_none(f->port), 0);
    clock_gettime(CLOCK_REALTIME, &before);
    write_raw(ecu, 0x123);
    write_raw(ecu, 0x12345678 | CAN_EFF_FLAG);
    clock_gettime(CLOCK_REALTIME, &after);
    assert_true(readable(port_fd(f->port), WAIT_MS));
    assert_int_equal(read_all(f->port, frames), 2);
    assert_int_equal(frames[0].frame.id, 0x123);
    assert_int_equal(frames[0].frame.dlc, 2);
    assert_int_equal(frames[0].frame.data[1], 0x22);
    assert_int_equal(frames[1].frame.id, 0x12345678);
    assert_int_equal(frames[1].frame.flags, CW_FRAME_EXTENDED);
    for (unsigned i = 0; i < 2; i++) {
        assert_true(frames[i].realtime_ns >= before.tv_sec * INT64_C(1000000000) + before.tv_nsec);
        assert_true(frames[i].realtime_ns <= after.tv_sec * INT64_C(1000000000) + after.tv_nsec);
    }
    assert_false(readable(port_fd(f->port), 0));
    close(ecu);
}

ON_PORT(frames_go_to_the_ecu_and_error_frames_too)
{
    fixture *f = *state;
    struct can_frame out;
    int ecu = connect_with(f->path, 0);
    const cw_frame frame = {
        .id = 0x1ABCDEF0, .flags = CW_FRAME_EXTENDED, .dlc = 3, .data = {1, 2, 3}};
    const errframe error = {.can_id = CAN_ERR_FLAG | CAN_ERR_BUSOFF};
    assert_int_equal(read_none(f->port), 0);
    assert_true(port_write(f->port, &frame));
    assert_true(port_write_error(f->port, &error, 0));
    assert_int_equal(recv(ecu, &out, sizeof out, 0), sizeof out);
    assert_int_equal(out.can_id, 0x1ABCDEF0 | CAN_EFF_FLAG);
    assert_int_equal(out.len, 3);
    assert_memory_equal(out.data, frame.data, 3);
    assert_int_equal(recv(ecu, &out, sizeof out, 0), sizeof out);
    assert_int_equal(out.can_id, CAN_ERR_FLAG | CAN_ERR_BUSOFF);
    assert_int_equal(stats_of(f->port).written, 1);
    assert_int_equal(stats_of(f->port).errors_written, 1);
    close(ecu);
}

/* len8_dlc counts where it can be the DLC of eight bytes; the bus does not get to know what a
 * program left behind the data. */
ON_PORT(only_what_counts_in_a_frame_is_taken)
{
    static const struct {
        uint32_t can_id;
        uint8_t len, len8_dlc, dlc, length;
    } cases[] = {
        {0x123, 2, 12, 2, 2},  {0x123, 8, 8, 8, 8},   {0x123, 8, 9, 9, 8},
        {0x123, 8, 15, 15, 8}, {0x123, 8, 16, 8, 8},  {0x123, 8, 255, 8, 8},
        {0x123, 0, 0, 0, 0},   {0x123 | CAN_RTR_FLAG, 5, 0, 5, 0},
    };
    fixture *f = *state;
    port_frame frames[PORT_BATCH];
    int ecu = connect_with(f->path, 0);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct can_frame raw = raw_frame(cases[i].can_id, 8);
        raw.len = cases[i].len;
        raw.len8_dlc = cases[i].len8_dlc;
        assert_int_equal(send(ecu, &raw, sizeof raw, 0), sizeof raw);
        assert_int_equal(read_all(f->port, frames), 1);
        assert_true(cw_frame_valid(&frames[0].frame));
        assert_int_equal(frames[0].frame.dlc, cases[i].dlc);
        for (unsigned k = 0; k < 8; k++)
            assert_int_equal(frames[0].frame.data[k], k < cases[i].length ? raw.data[k] : 0);
    }
    close(ecu);
}

/* An empty message is none that ends the connection. */
ON_PORT(messages_that_are_no_frames_are_counted)
{
    fixture *f = *state;
    port_frame frames[PORT_BATCH];
    unsigned char bytes[200] = {0};
    int ecu = connect_with(f->path, 0);
    assert_int_equal(read_none(f->port), 0);
    static const size_t sizes[] = {0, 1, 15, 17, 71, 73, 200};
    for (size_t i = 0; i < sizeof sizes / sizeof sizes[0]; i++)
        assert_int_equal(send(ecu, bytes, sizes[i], 0), sizes[i]);
    const struct can_frame too_long = raw_frame(0x123, 9);
    assert_int_equal(send(ecu, &too_long, sizeof too_long, 0), sizeof too_long);
    write_raw(ecu, 0x7FF);
    assert_int_equal(read_all(f->port, frames), 1);
    assert_int_equal(frames[0].frame.id, 0x7FF);
    assert_int_equal(stats_of(f->port).malformed, 8);
    assert_int_equal(stats_of(f->port).read, 1);
    close(ecu);
}

static void write_fd(int fd, uint32_t can_id, unsigned length, unsigned flags)
{
    struct canfd_frame f = {.can_id = can_id, .len = (uint8_t)length, .flags = (uint8_t)flags};
    memset(f.data, 0xAA, sizeof f.data); /* behind the data, too, where it does not count */
    assert_int_equal(send(fd, &f, sizeof f, MSG_NOSIGNAL), sizeof f);
}

/* An ECU cannot choose the ESI. Older programs do not set CANFD_FDF: the size tells. A remote frame
 * is left to the bus, which has none of these. */
ON_PORT(fd_frames_are_read_with_their_flags)
{
    static const struct {
        uint32_t can_id;
        unsigned flags, expected;
        bool valid;
    } cases[] = {
        {0x123, 0, CW_FRAME_FD, true},
        {0x123, CANFD_FDF, CW_FRAME_FD, true},
        {0x123, CANFD_FDF | CANFD_BRS, CW_FRAME_FD | CW_FRAME_BRS, true},
        {0x123, CANFD_ESI, CW_FRAME_FD, true},
        {0x123, 0xFF, CW_FRAME_FD | CW_FRAME_BRS, true},
        {0x12345678 | CAN_EFF_FLAG, CANFD_BRS, CW_FRAME_FD | CW_FRAME_BRS | CW_FRAME_EXTENDED,
         true},
        {0x123 | CAN_RTR_FLAG, 0, CW_FRAME_FD | CW_FRAME_REMOTE, false},
        {0x800, 0, CW_FRAME_FD, false},
    };
    fixture *f = *state;
    port_frame frames[PORT_BATCH];
    int ecu = connect_with(f->path, 0);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        write_fd(ecu, cases[i].can_id, 12, cases[i].flags);
        assert_int_equal(read_all(f->port, frames), 1);
        assert_int_equal(frames[0].frame.id, cases[i].can_id & CAN_EFF_MASK);
        assert_int_equal(frames[0].frame.flags, cases[i].expected);
        assert_int_equal(frames[0].frame.dlc, 9);
        assert_int_equal(cw_frame_valid(&frames[0].frame), cases[i].valid);
    }
    write_fd(ecu, CAN_ERR_FLAG | CAN_ERR_BUSOFF, 8, 0);
    write_raw(ecu, CAN_ERR_FLAG | CAN_ERR_BUSOFF);
    assert_int_equal(read_all(f->port, frames), 0);
    assert_int_equal(stats_of(f->port).errors_ignored, 2);
    assert_int_equal(stats_of(f->port).rounded, 0);
    close(ecu);
}

ON_PORT(lengths_that_no_dlc_has_are_rounded_up_with_zeros_and_counted)
{
    static const unsigned lengths[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    fixture *f = *state;
    port_frame frames[PORT_BATCH];
    unsigned dlc = 0, rounded = 0;
    int ecu = connect_with(f->path, 0);
    for (unsigned length = 0; length <= 64; length++) {
        write_fd(ecu, 0x123, length, CANFD_FDF);
        assert_int_equal(read_all(f->port, frames), 1);
        dlc += length > lengths[dlc];
        rounded += length < lengths[dlc];
        assert_int_equal(frames[0].frame.dlc, dlc);
        for (unsigned i = 0; i < 64; i++)
            assert_int_equal(frames[0].frame.data[i], i < length ? 0xAA : 0);
        assert_int_equal(stats_of(f->port).rounded, rounded);
    }
    assert_int_equal(rounded, 65 - 16);
    write_fd(ecu, 0x123, 65, CANFD_FDF);
    assert_int_equal(read_all(f->port, frames), 0);
    assert_int_equal(stats_of(f->port).malformed, 1);
    close(ecu);
}

static void read_fd(int ecu, struct canfd_frame *out)
{
    memset(out, 0xFF, sizeof *out);
    assert_int_equal(recv(ecu, out, sizeof *out, 0), sizeof *out);
}

/* Classical frames and error frames stay as they are for an ECU that takes FD frames. */
ON_PORT(fd_frames_go_to_an_ecu_that_has_sent_one)
{
    fixture *f = *state;
    struct canfd_frame out;
    int ecu = connect_with(f->path, 0);
    cw_frame frame = {.id = 0x123, .flags = CW_FRAME_FD | CW_FRAME_BRS, .dlc = 15, .data = {1, 2}};
    const errframe error = {.can_id = CAN_ERR_FLAG | CAN_ERR_BUSOFF};
    frame.data[63] = 0x64;
    write_fd(ecu, 0x100, 0, CANFD_FDF);
    assert_int_equal(read_none(f->port), 1);
    assert_true(port_write(f->port, &frame));
    read_fd(ecu, &out);
    assert_int_equal(out.can_id, 0x123);
    assert_int_equal(out.len, 64);
    assert_int_equal(out.flags, CANFD_FDF | CANFD_BRS);
    assert_memory_equal(out.data, frame.data, 64);
    frame = (cw_frame){.id = 0x123, .flags = CW_FRAME_FD | CW_FRAME_ESI | CW_FRAME_EXTENDED,
                       .dlc = 9, .data = {7}};
    assert_true(port_write(f->port, &frame));
    read_fd(ecu, &out);
    assert_int_equal(out.can_id, 0x123 | CAN_EFF_FLAG);
    assert_int_equal(out.len, 12);
    assert_int_equal(out.flags, CANFD_FDF | CANFD_ESI);
    for (unsigned i = 12; i < 64; i++)
        assert_int_equal(out.data[i], 0);
    frame = rig_frame(0x124, 0, 3);
    assert_true(port_write(f->port, &frame));
    assert_int_equal(recv(ecu, &out, sizeof out, 0), CAN_MTU);
    assert_true(port_write_error(f->port, &error, 0));
    assert_int_equal(recv(ecu, &out, sizeof out, 0), CAN_MTU);
    assert_int_equal(stats_of(f->port).written, 3);
    close(ecu);
}

/* The begin of 72 bytes would look like a frame to a program that reads 16. A new ECU starts anew.
 * One that only listens sends an error frame of 72 bytes. */
ON_PORT(an_ecu_that_has_sent_no_fd_frame_gets_none)
{
    fixture *f = *state;
    struct canfd_frame out;
    const cw_frame fd = {.id = 0x123, .flags = CW_FRAME_FD, .dlc = 15};
    const cw_frame classical = rig_frame(0x124, 0, 3);
    for (unsigned round = 1; round <= 2; round++) {
        int ecu = connect_with(f->path, 0);
        write_raw(ecu, 0x100);
        assert_int_equal(send(ecu, &out, 71, 0), 71);
        assert_int_equal(read_none(f->port), 1);
        assert_false(port_write(f->port, &fd));
        assert_true(port_write(f->port, &classical));
        assert_int_equal(recv(ecu, &out, sizeof out, 0), CAN_MTU);
        assert_int_equal(stats_of(f->port).unheard, round);
        assert_int_equal(stats_of(f->port).write_failed, 0);
        write_fd(ecu, CAN_ERR_FLAG, 0, 0);
        assert_int_equal(read_none(f->port), 0);
        assert_true(port_write(f->port, &fd));
        read_fd(ecu, &out);
        assert_int_equal(out.len, 64);
        close(ecu);
        assert_int_equal(read_none(f->port), 0);
    }
    assert_int_equal(stats_of(f->port).written, 4);
}

/* ---- ECUs come and go ------------------------------------------------------------------------ */

ON_PORT(nobody_hears_while_no_ecu_is_connected)
{
    fixture *f = *state;
    const cw_frame frame = rig_frame(0x123, 0, 1);
    const errframe error = {.can_id = CAN_ERR_FLAG | CAN_ERR_BUSOFF};
    assert_false(port_write(f->port, &frame));
    assert_false(port_write_error(f->port, &error, 0));
    port_stats s = stats_of(f->port);
    assert_int_equal(s.unheard, 1);
    assert_int_equal(s.errors_unheard, 1);
    assert_int_equal(s.written + s.write_failed + s.errors_failed, 0);
}

ON_PORT(what_an_ecu_sent_before_it_went_still_counts)
{
    fixture *f = *state;
    port_frame frames[2 * PORT_BATCH];
    for (unsigned round = 0; round < 3; round++) {
        int ecu = connect_with(f->path, 0);
        for (unsigned i = 0; i < PORT_BATCH + 1; i++)
            write_raw(ecu, i);
        close(ecu);
        const cw_frame frame = rig_frame(0x123, 0, 1);
        (void)port_write(f->port, &frame); /* must not shut it off */
        assert_int_equal(read_all(f->port, frames), PORT_BATCH + 1);
        assert_int_equal(frames[PORT_BATCH].frame.id, PORT_BATCH);
        assert_false(readable(port_fd(f->port), 0));
    }
    assert_int_equal(stats_of(f->port).connected, 3);
    assert_int_equal(stats_of(f->port).unheard, 3);
}

/* It has unread frames: the kernel reports that in its own way. */
ON_PORT(an_ecu_may_go_without_having_read)
{
    fixture *f = *state;
    const cw_frame frame = rig_frame(0x123, 0, 1);
    int ecu = connect_with(f->path, 0);
    assert_int_equal(read_none(f->port), 0);
    assert_true(port_write(f->port, &frame));
    close(ecu);
    assert_int_equal(read_none(f->port), 0);
    assert_false(readable(port_fd(f->port), 0));
    ecu = connect_with(f->path, 0);
    write_raw(ecu, 0x100);
    port_frame frames[PORT_BATCH];
    assert_int_equal(read_all(f->port, frames), 1);
    close(ecu);
}

/* That it has not read all must not hide what it sent. */
ON_PORT(what_an_ecu_sent_counts_also_when_it_has_not_read)
{
    fixture *f = *state;
    port_frame frames[2 * PORT_BATCH];
    const cw_frame frame = rig_frame(0x123, 0, 1);
    int ecu = connect_with(f->path, 0);
    assert_int_equal(read_none(f->port), 0);
    assert_true(port_write(f->port, &frame));
    for (unsigned i = 0; i < PORT_BATCH + 1; i++)
        write_raw(ecu, i);
    close(ecu);
    assert_int_equal(read_all(f->port, frames), PORT_BATCH + 1);
    assert_int_equal(frames[PORT_BATCH].frame.id, PORT_BATCH);
    assert_false(readable(port_fd(f->port), 0));
}

/* It came, wrote and went before anybody looked: the next one need not wait for that. */
ON_PORT(an_ecu_that_has_gone_unseen_leaves_its_place)
{
    fixture *f = *state;
    port_frame frames[PORT_BATCH];
    int first = connect_with(f->path, 0);
    write_raw(first, 0x100);
    close(first);
    int second = connect_with(f->path, 0);
    write_raw(second, 0x101);
    assert_int_equal(read_all(f->port, frames), 2);
    assert_int_equal(frames[1].frame.id, 0x101);
    assert_int_equal(stats_of(f->port).connected, 2);
    assert_int_equal(stats_of(f->port).refused, 0);
    close(second);
}

static unsigned count_descriptors(void)
{
    unsigned count = 0;
    for (int fd = 0; fd < 256; fd++)
        count += fcntl(fd, F_GETFD) >= 0;
    return count;
}

/* The descriptors were not requested, and would fill the table of a daemon that ignores them. Newer
 * kernels can refuse them. */
ON_PORT(descriptors_that_an_ecu_sends_along_are_not_taken)
{
    enum { PASSED = 30 };
    fixture *f = *state;
    port_frame frames[PORT_BATCH];
    _Alignas(struct cmsghdr) char control[CMSG_SPACE(PASSED * sizeof(int))] = {0};
    struct can_frame raw = raw_frame(0x123, 2);
    struct iovec vector = {.iov_base = &raw, .iov_len = sizeof raw};
    struct msghdr message = {.msg_iov = &vector,
                             .msg_iovlen = 1,
                             .msg_control = control,
                             .msg_controllen = sizeof control};
    int ecu = connect_with(f->path, 0);
    assert_int_equal(read_none(f->port), 0);
    struct cmsghdr *c = CMSG_FIRSTHDR(&message);
    *c = (struct cmsghdr){.cmsg_level = SOL_SOCKET,
                          .cmsg_type = SCM_RIGHTS,
                          .cmsg_len = CMSG_LEN(PASSED * sizeof(int))};
    for (unsigned i = 0; i < PASSED; i++)
        memcpy(CMSG_DATA(c) + i * sizeof ecu, &ecu, sizeof ecu);
    unsigned before = count_descriptors();
    if (sendmsg(ecu, &message, 0) < 0) {
        assert_int_equal(errno, EPERM);
        assert_int_equal(read_none(f->port), 0);
    } else {
        assert_int_equal(read_all(f->port, frames), 1);
        assert_true(frames[0].realtime_ns > 0);
    }
    assert_int_equal(count_descriptors(), before);
    close(ecu);
}

ON_PORT(a_second_ecu_is_refused_until_the_first_has_gone)
{
    fixture *f = *state;
    char byte;
    int first = connect_with(f->path, 0);
    assert_int_equal(read_none(f->port), 0);
    int second = connect_with(f->path, 0);
    assert_int_equal(read_none(f->port), 0);
    assert_int_equal(recv(second, &byte, 1, 0), 0);
    close(second);
    assert_int_equal(stats_of(f->port).refused, 1);
    close(first);
    second = connect_with(f->path, 0);
    write_raw(second, 0x100);
    port_frame frames[PORT_BATCH];
    assert_int_equal(read_all(f->port, frames), 1);
    close(second);
}

/* Once when it begins and once when it ends; who has gone is no failure. */
ON_PORT(reads_that_fail_are_counted_and_told)
{
    static const int refusals[] = {ENOMEM, EINTR, EAGAIN, ECONNRESET};
    fixture *f = *state;
    int error = 0;
    for (unsigned i = 0; i < sizeof refusals / sizeof refusals[0]; i++) {
        bool fails = refusals[i] == ENOMEM;
        int ecu = connect_with(f->path, 0);
        assert_int_equal(read_none(f->port), 0);
        write_raw(ecu, 0x100);
        refusal = refusals[i];
        assert_int_equal(read_none(f->port), 0);
        refusal = 0;
        assert_int_equal(port_reading_changed(f->port, &error), fails);
        assert_int_equal(error, fails ? ENOMEM : 0);
        assert_false(port_reading_changed(f->port, &error));
        assert_int_equal(stats_of(f->port).read_failed, 1);
        close(ecu);
        (void)read_none(f->port);
        ecu = connect_with(f->path, 0);
        write_raw(ecu, 0x100);
        port_frame frames[PORT_BATCH];
        assert_int_equal(read_all(f->port, frames), 1);
        assert_int_equal(port_reading_changed(f->port, &error), fails);
        assert_int_equal(error, 0);
        close(ecu);
        (void)read_none(f->port);
    }
}

ON_PORT(what_a_slow_ecu_has_no_room_for_is_counted)
{
    fixture *f = *state;
    const cw_frame frame = rig_frame(0x123, 0, 8);
    struct can_frame out;
    uint64_t room = 0;
    int ecu = connect_with(f->path, 0);
    assert_int_equal(read_none(f->port), 0);
    while (port_write(f->port, &frame))
        room++;
    assert_true(room >= 100);
    assert_int_equal(stats_of(f->port).write_failed, 1);
    assert_int_equal(stats_of(f->port).written, room);
    assert_int_equal(recv(ecu, &out, sizeof out, 0), sizeof out);
    assert_true(port_write(f->port, &frame));
    close(ecu);
}

/* A connection that cannot be accepted must not keep the loop awake, and is accepted later. */
ON_PORT(running_out_of_descriptors_is_got_over)
{
    fixture *f = *state;
    struct rlimit limit, none;
    port_frame frames[PORT_BATCH];
    int ecu = connect_with(f->path, 0);
    write_raw(ecu, 0x100);
    assert_int_equal(getrlimit(RLIMIT_NOFILE, &limit), 0);
    none = (struct rlimit){.rlim_cur = 0, .rlim_max = limit.rlim_max};
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &none), 0);
    unsigned read_without = read_all(f->port, frames);
    assert_int_equal(setrlimit(RLIMIT_NOFILE, &limit), 0);
    assert_int_equal(read_without, 0);
    assert_false(readable(port_fd(f->port), 0));
    assert_int_equal(read_all(f->port, frames), 1);
    close(ecu);
    assert_int_equal(read_none(f->port), 0);
    ecu = connect_with(f->path, 0);
    assert_true(readable(port_fd(f->port), WAIT_MS));
    close(ecu);
    assert_int_equal(read_none(f->port), 0);
}

/* ---- Opening --------------------------------------------------------------------------------- */

ON_PORT(the_socket_is_for_user_and_group_alone)
{
    fixture *f = *state;
    struct stat s;
    assert_int_equal(stat(f->path, &s), 0);
    assert_true(S_ISSOCK(s.st_mode));
    assert_int_equal(s.st_mode & 0777, 0660);
}

ON_PORT(a_path_in_use_cannot_be_opened_a_stale_one_can)
{
    fixture *f = *state;
    char error[PORT_ERROR_TEXT_MAX] = "";
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    assert_null(port_open(f->name, "bus", error));
    assert_non_null(strstr(error, "in use"));
    port_close(f->port);
    strcpy(address.sun_path, f->path);
    int stale = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    assert_int_equal(bind(stale, (struct sockaddr *)&address, sizeof address), 0);
    close(stale);
    f->port = port_open(f->name, "bus", error);
    assert_non_null(f->port);
}

typedef struct open_case {
    const char *name;
    const char *error;
} open_case;

TEST(what_cannot_be_opened_says_why)
{
    static const open_case cases[] = {
        {"unix:/nowhere/at/all", "the directory does not exist"},
        {"unix:/dev/null", "no socket"},
        {"fd:999999", "Bad file descriptor"},
        {"a/b", "expected the name of an interface"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char error[PORT_ERROR_TEXT_MAX] = "";
        assert_null(port_open(cases[i].name, "bus", error));
        assert_non_null(strstr(error, cases[i].error));
    }
}

static port *open_fd(int fd, char error[PORT_ERROR_TEXT_MAX])
{
    char name[20];
    snprintf(name, sizeof name, "fd:%d", fd);
    return port_open(name, "bus", error);
}

/* Sockets of the daemon itself do not count: they are closed on exec. */
TEST(only_inherited_connected_sockets_are_taken)
{
    static const int types[] = {SOCK_STREAM, SOCK_DGRAM, SOCK_SEQPACKET | SOCK_CLOEXEC};
    char error[PORT_ERROR_TEXT_MAX];
    int pair[2];
    for (size_t i = 0; i < sizeof types / sizeof types[0]; i++) {
        assert_int_equal(socketpair(AF_UNIX, types[i], 0, pair), 0);
        assert_null(open_fd(pair[0], error));
        assert_non_null(strstr(error, "no inherited Unix socket"));
        assert_int_equal(close(pair[0]) + close(pair[1]), 0);
    }
    int alone = socket(AF_UNIX, SOCK_SEQPACKET, 0);
    assert_null(open_fd(alone, error));
    close(alone);
    int file = open("/dev/null", O_RDONLY);
    assert_null(open_fd(file, error));
    close(file);
}

TEST(an_inherited_socket_is_a_port_until_its_ecu_goes)
{
    char error[PORT_ERROR_TEXT_MAX];
    port_frame frames[PORT_BATCH];
    int pair[2];
    assert_int_equal(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, pair), 0);
    port *p = open_fd(pair[0], error);
    assert_non_null(p);
    assert_null(open_fd(pair[0], error)); /* it is the port's */
    write_raw(pair[1], 0x123);
    assert_int_equal(read_all(p, frames), 1);
    close(pair[1]);
    assert_true(readable(port_fd(p), WAIT_MS));
    assert_int_equal(read_none(p), 0);
    assert_false(readable(port_fd(p), 0));
    port_close(p);
    assert_int_equal(fcntl(pair[0], F_GETFD), -1);
}

/* ---- The engine ------------------------------------------------------------------------------ */

typedef struct exchange {
    struct ev_loop *loop;
    live *live;
    engine *engine;
    int ecus[2];
    unsigned wanted; /* events */
    unsigned seen;
    cw_event_kind kind;
    uint64_t ticks[16]; /* of these events */
} exchange;

static const char *const pacings[] = {"precise", "tick", "spin"};

static void count_event(void *user, const cw_event *event)
{
    exchange *x = user;
    if (event->kind == x->kind && x->seen < sizeof x->ticks / sizeof x->ticks[0])
        x->ticks[x->seen++] = event->tick;
    if (x->seen == x->wanted)
        ev_break(x->loop, EVBREAK_ALL);
}

static void give_up(struct ev_loop *loop, ev_timer *timer, int events)
{
    (void)timer;
    (void)events;
    ev_break(loop, EVBREAK_ALL);
}

/* Runs until so many events have come, or that is hopeless. */
static void run_until(exchange *x, cw_event_kind kind, unsigned count)
{
    ev_timer limit;
    x->kind = kind;
    x->wanted = count;
    x->seen = 0;
    ev_timer_init(&limit, give_up, WAIT_MS / 1000.0, 0);
    ev_now_update(x->loop);
    ev_timer_start(x->loop, &limit);
    ev_run(x->loop, 0);
    ev_timer_stop(x->loop, &limit);
    assert_int_equal(x->seen, count);
}

static void start_exchange(exchange *x, const char *folder, const char *pacing)
{
    char file[100];
    int ends[2][2];
    *x = (exchange){.loop = ev_loop_new(EVFLAG_AUTO)};
    snprintf(file, sizeof file, "%s/bus.yaml", folder);
    FILE *out = fopen(file, "w");
    assert_non_null(out);
    fprintf(out, "bus: { bitrate: 1000000 }\npacing: %s\nnodes:\n", pacing);
    for (unsigned i = 0; i < 2; i++) {
        assert_int_equal(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends[i]), 0);
        x->ecus[i] = ends[i][1];
        fprintf(out, "  - { name: n%u, port: \"fd:%d\" }\n", i, ends[i][0]);
    }
    fclose(out);
    x->live = live_new(cfg_load(file, stderr));
    assert_non_null(x->live);
    x->engine = engine_start(x->loop, x->live);
    assert_non_null(x->engine);
    engine_observe(x->engine, count_event, x);
    assert_int_equal(unlink(file), 0);
}

static void end_exchange(exchange *x)
{
    engine_free(x->engine);
    live_free(x->live);
    ev_loop_destroy(x->loop);
    assert_int_equal(close(x->ecus[0]), 0);
    if (x->ecus[1] >= 0)
        assert_int_equal(close(x->ecus[1]), 0);
}

/* Exchanges frames. When one ECU has gone the other goes on: its frames are acknowledged, but
 * unheard. */
static void exchange_frames(const char *folder, const char *pacing)
{
    exchange x;
    struct can_frame out;
    report beyond;
    start_exchange(&x, folder, pacing);
    for (unsigned i = 0; i < 10; i++)
        write_raw(x.ecus[0], 0x100 + i);
    run_until(&x, CW_EVENT_TX, 10);
    for (unsigned i = 0; i < 10; i++) {
        assert_int_equal(recv(x.ecus[1], &out, sizeof out, MSG_DONTWAIT), sizeof out);
        assert_int_equal(out.can_id, 0x100 + i);
    }
    assert_int_equal(recv(x.ecus[0], &out, sizeof out, MSG_DONTWAIT), -1); /* none of its own */
    write_raw(x.ecus[1], 0x300);
    run_until(&x, CW_EVENT_TX, 1);
    assert_int_equal(recv(x.ecus[0], &out, sizeof out, MSG_DONTWAIT), sizeof out);
    close(x.ecus[1]);
    x.ecus[1] = -1;
    write_raw(x.ecus[0], 0x200);
    run_until(&x, CW_EVENT_TX, 1);
    engine_report(x.engine, &beyond);
    assert_int_equal(beyond.nodes[1].interface.unheard, 1);
    assert_true(beyond.nodes[0].conserved && beyond.nodes[1].conserved);
    end_exchange(&x);
}

ON_PORT(ecus_exchange_frames_through_the_engine)
{
    fixture *f = *state;
    for (unsigned i = 0; i < sizeof pacings / sizeof pacings[0]; i++)
        exchange_frames(f->folder, pacings[i]);
}

/* A frame starts at the time of its writing, whenever the engine wakes up. Two frames written 3 ms
 * apart are so on the bus, also when the engine reads both at once. */
ON_PORT(pacing_does_not_shift_the_bus)
{
    fixture *f = *state;
    for (unsigned i = 0; i < sizeof pacings / sizeof pacings[0]; i++) {
        exchange x;
        start_exchange(&x, f->folder, pacings[i]);
        const struct timespec pause = {.tv_nsec = 3000000};
        for (unsigned k = 0; k < 2; k++) {
            write_raw(x.ecus[0], 0x100 + k);
            nanosleep(&pause, NULL); /* no polling: the ECU's time goes by */
        }
        run_until(&x, CW_EVENT_TX, 2); /* it had no chance to see them before */
        int64_t apart_ns = (int64_t)(x.ticks[1] - x.ticks[0]) * 25 / 2;
        assert_true(apart_ns > 2 * CLOCKS_NS); /* not when the engine saw them, which was at once */
        end_exchange(&x);
    }
}
