/* SPDX-License-Identifier: MIT
 *
 * test_port_clients.c - programs that share a port, and doors.
 */
#include "port_rig.h"

#include "port/door.h"
#include "port/member.h"
#include "port/underway.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/can/error.h>

#define INVERTED CAN_INV_FILTER

static void share(fixture *f, port_echo echo)
{
    const port_sharing sharing = {.node = "engine", .fd = true, .max = 3, .echo = echo};
    port_share(f->port, &sharing);
}

static int set_up(void **state)
{
    (void)set_up_port(state);
    share(*state, PORT_ECHO_AT_ONCE);
    return 0;
}

static int set_up_door(void **state)
{
    char error[PORT_ERROR_TEXT_MAX];
    fixture *f = make_fixture(state);
    f->port = door_open(f->name, error);
    assert_non_null(f->port);
    return 0;
}

static int connect_to(const fixture *f)
{
    return connect_with(f->path, SOCK_NONBLOCK);
}

static void send_to(int fd, unsigned type, unsigned number, const void *body, size_t size)
{
    unsigned char bytes[sizeof(message_head) + 200];
    const message_head head = {.type = (uint8_t)type,
                               .size = (uint16_t)(sizeof head + size),
                               .number = number};
    memcpy(bytes, &head, sizeof head);
    memcpy(bytes + sizeof head, body, size);
    assert_int_equal(send(fd, bytes, head.size, MSG_NOSIGNAL), head.size);
}

static void say_hello(int fd, const char *name, uint32_t options)
{
    message_hello hello = {.magic = MESSAGE_MAGIC, .version = MESSAGE_VERSION, .options = options};
    snprintf(hello.name, sizeof hello.name, "%s", name);
    send_to(fd, MESSAGE_HELLO, 0, &hello, sizeof hello);
}

static void send_id(int fd, uint32_t can_id, unsigned number)
{
    const struct can_frame frame = {.can_id = can_id, .len = 1, .data = {0x55}};
    send_to(fd, MESSAGE_FRAME, number, &frame, sizeof frame);
}

static bool receive(int fd, message *m)
{
    memset(m, 0, sizeof *m);
    ssize_t size = recv(fd, m, sizeof *m, MSG_DONTWAIT);
    assert_true(size < 0 ? errno == EAGAIN : size == m->head.size);
    return size > 0;
}

static void read_nothing(port *p)
{
    port_frame frames[PORT_BATCH];
    assert_int_equal(read_all(p, frames), 0);
}

/* Returns the socket of a client that has been welcomed. */
static int join(fixture *f, uint32_t options)
{
    message m;
    int fd = connect_to(f);
    say_hello(fd, "tester", options);
    read_nothing(f->port); /* accepts it */
    read_nothing(f->port);
    assert_true(receive(fd, &m));
    assert_int_equal(m.head.type, MESSAGE_HELLO);
    assert_int_equal(m.hello.mtu, CANFD_MTU);
    assert_string_equal(m.hello.name, "engine");
    return fd;
}

/* ---- Filters --------------------------------------------------------------------------------- */

/* As can_rcv_list_find() and the receive lists of Linux have it. */
TEST(filters_let_pass_what_the_kernels_do)
{
    static const struct {
        canid_t id, mask, frame;
        bool passes;
    } cases[] = {
        {0, 0, 0x123, true},
        {0, 0, 0x123 | CAN_EFF_FLAG, true},
        {0, 0, CAN_ERR_FLAG | CAN_ERR_BUSOFF, false},
        {0x123, CAN_SFF_MASK, 0x123, true},
        {0x123, CAN_SFF_MASK, 0x124, false},
        {0x123, CAN_SFF_MASK, 0x10000123 | CAN_EFF_FLAG, true},
        {0x123, CAN_SFF_MASK | CAN_EFF_FLAG, 0x123 | CAN_EFF_FLAG, false},
        {0x123, CAN_EFF_MASK | CAN_EFF_FLAG, 0x123, true},
        {0x123 | CAN_EFF_FLAG, CAN_EFF_MASK | CAN_EFF_FLAG, 0x123, false},
        {0x123 | CAN_EFF_FLAG, CAN_EFF_MASK | CAN_EFF_FLAG, 0x123 | CAN_EFF_FLAG, true},
        {0x123, CAN_SFF_MASK | CAN_RTR_FLAG, 0x123 | CAN_RTR_FLAG, false},
        {0x123 | CAN_RTR_FLAG, CAN_SFF_MASK | CAN_RTR_FLAG, 0x123 | CAN_RTR_FLAG, true},
        {0x123 | INVERTED, CAN_SFF_MASK, 0x123, false},
        {0x123 | INVERTED, CAN_SFF_MASK, 0x124, true},
        {0x123 | INVERTED, CAN_SFF_MASK, CAN_ERR_FLAG | CAN_ERR_BUSOFF, false},
        {0, CAN_ERR_FLAG | CAN_ERR_BUSOFF, CAN_ERR_FLAG | CAN_ERR_BUSOFF, true},
        {0, CAN_ERR_FLAG | CAN_ERR_BUSOFF, CAN_ERR_FLAG | CAN_ERR_CRTL, false},
        {0, CAN_ERR_FLAG | CAN_ERR_MASK, 0x40, false},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        struct can_filter filter = {.can_id = cases[i].id, .can_mask = cases[i].mask};
        const struct can_frame frame = {.can_id = cases[i].frame};
        const member m = {.state = MEMBER_THERE,
                          .kind = &member_messages,
                          .filters = &filter,
                          .filter_count = 1};
        assert_int_equal(member_takes(&m, &frame, sizeof frame), cases[i].passes);
    }
}

/* ---- Frames under way ------------------------------------------------------------------------ */

static port_frame frame_of(uint32_t id, uint32_t number)
{
    return (port_frame){.frame = rig_frame(id, 0, 2), .client = 7, .number = number};
}

static cw_event event_of(cw_event_kind kind, const port_frame *frame, uint64_t tick)
{
    cw_event event = {.kind = kind, .frame = frame->frame};
    *(kind == CW_EVENT_TX ? &event.handed_in : &event.tick) = tick;
    return event;
}

static void expect_taken(underway *u, const cw_event *event, uint32_t number)
{
    port_frame out;
    assert_true(underway_take(u, &out, event));
    assert_int_equal(out.number, number);
}

/* Three equal frames: a queue that was full drops the last; the others leave in their order. */
TEST(equal_frames_are_told_apart_by_their_hand_in)
{
    underway u = {.frames = NULL};
    for (unsigned i = 0; i < 3; i++) {
        const port_frame frame = frame_of(0x100, i);
        assert_true(underway_add(&u, &frame, 1000 + i));
    }
    const port_frame frame = frame_of(0x100, 0);
    const cw_event dropped = event_of(CW_EVENT_DROP, &frame, 1002);
    const cw_event later = event_of(CW_EVENT_TX, &frame, 5); /* time was skipped meanwhile */
    const cw_event sent = event_of(CW_EVENT_TX, &frame, 1001);
    port_frame out;
    expect_taken(&u, &dropped, 2);
    expect_taken(&u, &later, 0);
    expect_taken(&u, &sent, 1);
    assert_false(underway_take(&u, &out, &sent));
    underway_free(&u);
}

TEST(a_frame_that_a_rule_has_changed_is_known_by_its_hand_in)
{
    underway u = {.frames = NULL};
    const port_frame first = frame_of(0x100, 1), second = frame_of(0x200, 2);
    const port_frame changed = frame_of(0x300, 0);
    assert_true(underway_add(&u, &first, 10) && underway_add(&u, &second, 20));
    const cw_event sent = event_of(CW_EVENT_TX, &changed, 20);
    const cw_event made = event_of(CW_EVENT_TX, &changed, 15);
    port_frame out;
    assert_false(underway_take(&u, &out, &made)); /* a rule has sent it */
    expect_taken(&u, &sent, 2);
    assert_int_equal(u.count, 1);
    underway_free(&u);
}

TEST(the_controller_sets_the_esi)
{
    underway u = {.frames = NULL};
    port_frame fd = frame_of(0x100, 4);
    fd.frame.flags = CW_FRAME_FD | CW_FRAME_BRS;
    assert_true(underway_add(&u, &fd, 10));
    cw_event sent = event_of(CW_EVENT_TX, &fd, 3);
    sent.frame.flags |= CW_FRAME_ESI;
    expect_taken(&u, &sent, 4);
    underway_free(&u);
}

TEST(the_oldest_gives_way_when_there_are_too_many)
{
    underway u = {.frames = NULL};
    unsigned count = 0;
    for (port_frame frame = frame_of(0x100, 0); underway_add(&u, &frame, count); count++)
        frame = frame_of(0x100, count + 1);
    assert_true(count > CW_QUEUE_MAX);
    assert_int_equal(u.count, count);
    const port_frame frame = frame_of(0x100, 0);
    const cw_event sent = event_of(CW_EVENT_TX, &frame, CW_NEVER);
    expect_taken(&u, &sent, 1);
    underway_free(&u);
}

#define ON_PORT(test) TEST_WITH(test, set_up, tear_down)

/* ---- Sharing --------------------------------------------------------------------------------- */

ON_PORT(frames_come_in_the_order_in_which_they_were_sent)
{
    fixture *f = *state;
    port_frame frames[3 * PORT_BATCH];
    int clients[] = {join(f, 0), join(f, 0), join(f, 0)};
    for (unsigned i = 0; i < 90; i++)
        send_id(clients[(i * i) % 3], i, i);
    assert_int_equal(read_all(f->port, frames), 90);
    for (unsigned i = 0; i < 90; i++) {
        assert_int_equal(frames[i].frame.id, i);
        assert_int_equal(frames[i].number, i);
        assert_true(i == 0 || frames[i].realtime_ns >= frames[i - 1].realtime_ns);
    }
    assert_int_equal(stats_of(f->port).read, 90);
    for (unsigned i = 0; i < 3; i++)
        close(clients[i]);
}

/* While frames wait, one program cannot keep the others waiting behind all of its frames. */
ON_PORT(programs_take_turns_when_frames_have_to_wait)
{
    fixture *f = *state;
    port_frame frames[PORT_BATCH];
    bool more;
    int flood = join(f, 0), polite = join(f, 0);
    for (unsigned i = 0; i < 50; i++)
        send_id(flood, 0x700, i);
    for (unsigned i = 0; i < 3; i++)
        send_id(polite, 0x100, i);
    port_pushed_back(f->port);
    unsigned of_polite = 0;
    for (unsigned i = 0; i < 6; i++) {
        assert_int_equal(port_read(f->port, frames, 1, &more), 1);
        of_polite += frames[0].frame.id == 0x100;
        assert_true(more);
    }
    assert_int_equal(of_polite, 3);
    assert_int_equal(read_all(f->port, frames), 47);
    close(flood);
    close(polite);
}

ON_PORT(a_client_is_told_what_it_has_lost)
{
    fixture *f = *state;
    const cw_frame frame = rig_frame(0x123, 0, 8);
    message m;
    uint64_t room = 0;
    int deaf = join(f, 0), reader = join(f, 0);
    while (stats_of(f->port).clients_lost < 2) {
        assert_true(port_write(f->port, &frame)); /* one has got it */
        assert_true(receive(reader, &m) && m.head.lost == 0);
        room++;
    }
    assert_int_equal(stats_of(f->port).written, room);
    for (uint64_t i = 0; i < room - 2; i++)
        assert_true(receive(deaf, &m) && m.head.lost == 0);
    assert_false(receive(deaf, &m));
    assert_true(port_write(f->port, &frame));
    assert_true(receive(deaf, &m));
    assert_int_equal(m.head.lost, 2);
    close(reader);
    close(deaf);
}

ON_PORT(times_are_those_of_the_bus)
{
    fixture *f = *state;
    const cw_frame frame = rig_frame(0x123, 0, 8);
    message m;
    int client = join(f, 0);
    port_set_time(f->port, 80000001, 1234567890123456789);
    assert_true(port_write(f->port, &frame));
    assert_true(receive(client, &m));
    assert_int_equal(m.head.bus_ns, 1000000012);
    assert_int_equal(m.head.realtime_ns, 1234567890123456789);
    close(client);
}

/* Runs a frame through the port, and counts the messages that each of three programs gets. */
static void hand_in(fixture *f, int sender, unsigned number)
{
    port_frame frames[PORT_BATCH];
    send_id(sender, 0x100, number);
    assert_int_equal(read_all(f->port, frames), 1);
    port_set_time(f->port, 100 + number, 5);
    port_handed_in(f->port, &frames[0]);
}

ON_PORT(both_ways_of_echo_reach_the_others_once)
{
    fixture *f = *state;
    message m;
    int sender = join(f, MESSAGE_LOOPBACK | MESSAGE_RECV_OWN), other = join(f, 0);
    for (unsigned echo = PORT_ECHO_AT_ONCE; echo <= PORT_ECHO_SENT; echo++) {
        share(f, (port_echo)echo);
        hand_in(f, sender, echo);
        assert_int_equal(receive(other, &m), echo == PORT_ECHO_AT_ONCE);
        assert_false(receive(sender, &m));
        const port_frame same = {.frame = {.id = 0x100, .dlc = 1, .data = {0x55}}};
        const cw_event sent = event_of(CW_EVENT_TX, &same, 100 + echo);
        port_ended(f->port, &sent);
        assert_int_equal(receive(other, &m), echo == PORT_ECHO_SENT);
        assert_true(receive(sender, &m));
        assert_int_equal(m.head.flags, MESSAGE_LOCAL | MESSAGE_OWN);
        assert_int_equal(m.head.number, echo);
        port_ended(f->port, &sent); /* a rule has sent the same once more */
        assert_false(receive(other, &m) || receive(sender, &m));
    }
    assert_int_equal(stats_of(f->port).echoed, 4);
    close(sender);
    close(other);
}

ON_PORT(who_has_gone_gets_nothing_back)
{
    fixture *f = *state;
    message m;
    share(f, PORT_ECHO_SENT);
    int sender = join(f, MESSAGE_LOOPBACK | MESSAGE_RECV_OWN), other = join(f, 0);
    hand_in(f, sender, 1);
    close(sender);
    read_nothing(f->port);
    int next = join(f, MESSAGE_LOOPBACK | MESSAGE_RECV_OWN); /* at the same place */
    const port_frame same = {.frame = {.id = 0x100, .dlc = 1, .data = {0x55}}};
    const cw_event sent = event_of(CW_EVENT_TX, &same, 101);
    port_ended(f->port, &sent);
    assert_true(receive(other, &m));
    assert_true(receive(next, &m)); /* as any other program */
    assert_int_equal(m.head.flags, MESSAGE_LOCAL);
    close(other);
    close(next);
}

/* ---- Doors ----------------------------------------------------------------------------------- */

TEST_WITH(a_door_lets_in_those_who_say_hello_in_their_order, set_up_door, tear_down)
{
    fixture *f = *state;
    message m;
    port_frame frames[PORT_BATCH];
    int silent = connect_to(f), first = connect_to(f), second = connect_to(f);
    assert_null(door_next(f->port));
    read_nothing(f->port);
    say_hello(second, "second", 0);
    read_nothing(f->port);
    say_hello(first, "first", 0);
    send_id(first, 0x123, 1);
    read_nothing(f->port);
    assert_string_equal(door_next(f->port), "first");
    port *admitted = door_admit(f->port);
    assert_non_null(admitted);
    const port_sharing sharing = {.node = "node", .fd = false};
    port_share(admitted, &sharing);
    door_welcome(admitted);
    assert_true(receive(first, &m) && m.head.type == MESSAGE_HELLO && m.hello.mtu == CAN_MTU);
    assert_int_equal(read_all(admitted, frames), 1);
    assert_string_equal(door_next(f->port), "second");
    door_refuse(f->port, EEXIST, "no");
    assert_true(receive(second, &m) && m.head.type == MESSAGE_ERROR && m.error.code == EEXIST);
    assert_null(door_next(f->port));
    assert_false(port_is_over(admitted));
    close(first);
    assert_true(port_is_over(admitted)); /* before anything is read, too */
    assert_int_equal(read_all(admitted, frames), 0);
    assert_true(port_is_over(admitted));
    port_close(admitted);
    close(second);
    close(silent);
}
