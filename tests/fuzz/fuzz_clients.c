/* SPDX-License-Identifier: MIT
 *
 * fuzz_clients.c - programs of any kind that share a port, by its protocol or not.
 *
 * A plain ECU and some clients are at the port of one node; the other node only listens. Every
 * frame that a program may send is handed in once, in its order, and nothing else is. All messages
 * of the port are well formed, and a client gets its own frames back once at most. The counts of
 * port and bus agree.
 *
 * Input: the kind of echo, then operations until it is used up (operate()).
 */
#include "fuzz.h"

#include "port/member.h"
#include "port/open.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define PROGRAMS 5u /* the first is the plain ECU */
#define BIT_TICKS 160u
#define BITS_MAX 20000u
#define OPERATIONS_MAX 300u
#define TURNS_MAX 200u
#define FRAMES_MAX 4096u
#define BODY_MAX 100u

typedef struct program {
    int fd;           /* -1: it is not there */
    bool greeted;     /* the port has let it in, or will, as soon as it reads */
    uint32_t options; /* as it has sent them */
    unsigned next;    /* number of its next frame */
    unsigned asked;   /* questions for the end of its frames that have no answer yet */
    bool back[FRAMES_MAX]; /* frames that have come back */
} program;

typedef struct rig {
    fuzz_input in;
    fuzz_bus bus;
    unsigned bits;
    port *port;
    struct sockaddr_un address;
    program programs[PROGRAMS];
    uint64_t sent; /* frames for the bus */
    uint64_t read;
    uint64_t out;  /* frames of the bus for the port */
} rig;

/* ---- The programs ---------------------------------------------------------------------------- */

static void leave(program *p)
{
    if (p->fd >= 0)
        REQUIRE(close(p->fd) == 0);
    memset(p, 0, sizeof *p);
    p->fd = -1;
}

static void come(rig *r, unsigned i)
{
    const struct sockaddr_un none = {.sun_family = AF_UNIX};
    program *p = &r->programs[i];
    leave(p);
    p->fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    REQUIRE(p->fd >= 0);
    if (i > 0)
        REQUIRE(bind(p->fd, (const struct sockaddr *)&none, sizeof none.sun_family) == 0);
    REQUIRE(connect(p->fd, (const struct sockaddr *)&r->address, sizeof r->address) == 0);
    p->greeted = i == 0;
}

/* Writes a message. Returns false when it is not taken: the port may have closed the connection. */
static bool write_bytes(program *p, const void *bytes, size_t size)
{
    return p->fd >= 0 && send(p->fd, bytes, size, MSG_NOSIGNAL | MSG_DONTWAIT) >= 0;
}

static bool write_message(program *p, unsigned type, unsigned number, const void *body, size_t size)
{
    unsigned char bytes[sizeof(message_head) + BODY_MAX];
    const message_head head = {.type = (uint8_t)type,
                               .size = (uint16_t)(sizeof head + size),
                               .number = number};
    memcpy(bytes, &head, sizeof head);
    memcpy(bytes + sizeof head, body, size);
    return write_bytes(p, bytes, head.size);
}

static void say_hello(rig *r, program *p)
{
    const unsigned how = fuzz_u8(&r->in);
    message_hello hello = {.magic = MESSAGE_MAGIC,
                           .version = MESSAGE_VERSION,
                           .options = how & (how & 0x40u ? 0x3Fu : 0x1Fu),
                           .error_mask = how & 0x20u ? CAN_ERR_MASK : 0,
                           .name = "fuzzer"};
    if (how >= 0xE0u)
        ((unsigned char *)&hello)[how & 15u] ^= 0x80; /* magic, version or options are wrong */
    const bool first = p->fd >= 0 && !p->greeted && p->next == 0;
    if (!write_message(p, MESSAGE_HELLO, 0, &hello, sizeof hello) || !first)
        return;
    p->greeted = how < 0xE0u;
    p->options = hello.options;
    p->next = 1; /* only the first message can be a hello */
}

static bool is_for_the_bus(const program *p, const struct canfd_frame *frame, size_t size)
{
    const unsigned max = size == CAN_MTU ? CAN_MAX_DLEN : CANFD_MAX_DLEN;
    return (size == CAN_MTU || (p->options & MESSAGE_FD)) && frame->len <= max &&
           !(frame->can_id & CAN_ERR_FLAG);
}

static void send_frame(rig *r, unsigned i)
{
    program *p = &r->programs[i];
    const bool fd = fuzz_below(&r->in, 8) == 0;
    const size_t size = fd ? CANFD_MTU : CAN_MTU;
    struct canfd_frame frame = {.can_id = fuzz_below(&r->in, 0x800)};
    const unsigned how = fuzz_u8(&r->in);
    frame.len = how & 15u;
    frame.can_id |= how >= 0xF0u ? CAN_ERR_FLAG : how >= 0xC0u ? CAN_EFF_FLAG : 0;
    if (p->next >= FRAMES_MAX || r->sent > r->read + 400)
        return;
    if (i > 0 && !write_message(p, MESSAGE_FRAME, p->next, &frame, size))
        return;
    if (i == 0 && (fd || !write_bytes(p, &frame, size)))
        return;
    p->next++;
    if (p->greeted && is_for_the_bus(p, &frame, size))
        r->sent++;
}

static void set_options(rig *r, program *p)
{
    const unsigned how = fuzz_u8(&r->in);
    const message_options options = {.options = how};
    const bool right = how < MESSAGE_CONTROLLER; /* only a hello may have that one */
    if (write_message(p, MESSAGE_OPTIONS, 0, &options, sizeof options) && right && p->greeted)
        p->options = options.options;
    p->next += p->next == 0;
}

static void set_filters(rig *r, program *p)
{
    struct can_filter filters[4];
    const unsigned count = fuzz_below(&r->in, 5);
    for (unsigned i = 0; i < count; i++)
        filters[i] = (struct can_filter){.can_id = fuzz_u32(&r->in), .can_mask = fuzz_u32(&r->in)};
    (void)write_message(p, MESSAGE_FILTERS, 0, filters, count * sizeof *filters);
    p->next += p->next == 0;
}

/* Asks for the end of its frames. A question may take the place of one without an answer. */
static void ask_for_end(rig *r, program *p)
{
    const unsigned number = fuzz_u8(&r->in);
    if (!write_message(p, MESSAGE_FLUSH, number, "", 0))
        return;
    p->asked += p->greeted && (p->options & MESSAGE_FLUSHES);
    p->next += p->next == 0;
}

/* Writes a message that is no frame, whatever it is. */
static void write_nonsense(rig *r, program *p)
{
    unsigned char bytes[sizeof(message_head) + BODY_MAX];
    const unsigned size = 1 + fuzz_below(&r->in, sizeof bytes - 1);
    for (unsigned i = 0; i < size; i++)
        bytes[i] = fuzz_u8(&r->in);
    bytes[0] = (unsigned char)(bytes[0] | 0x80u);
    (void)write_bytes(p, bytes, size);
    p->next += p->next == 0;
}

/* ---- Messages of the port -------------------------------------------------------------------- */

static void check_own(program *p, const message_head *head)
{
    REQUIRE(head->flags == (MESSAGE_LOCAL | MESSAGE_OWN));
    REQUIRE(head->number > 0 && head->number < p->next && !p->back[head->number]);
    p->back[head->number] = true;
}

static void check_message(program *p, const message *m, size_t size)
{
    const size_t body = size - sizeof m->head;
    REQUIRE(size >= sizeof m->head && m->head.size == size && m->head.reserved == 0);
    REQUIRE(m->head.lost == 0); /* all is read in time */
    switch (m->head.type) {
    case MESSAGE_HELLO:
        REQUIRE(body == sizeof m->hello && strcmp(m->hello.name, "node") == 0);
        break;
    case MESSAGE_FRAME:
        REQUIRE(body == CAN_MTU || body == CANFD_MTU);
        REQUIRE(m->frame.len <= (body == CAN_MTU ? CAN_MAX_DLEN : CANFD_MAX_DLEN));
        if (m->head.flags & MESSAGE_OWN)
            check_own(p, &m->head);
        break;
    case MESSAGE_DROPPED:
        REQUIRE(m->head.number > 0 && m->head.number < p->next);
        break;
    case MESSAGE_FLUSH:
        REQUIRE(body == 0 && p->asked-- > 0);
        break;
    default:
        REQUIRE(m->head.type == MESSAGE_ERROR && m->error.code != 0);
    }
}

static void take_messages(program *p, bool plain)
{
    message m;
    ssize_t size = 0;
    while (p->fd >= 0 && (size = recv(p->fd, &m, sizeof m, MSG_DONTWAIT)) > 0)
        if (plain)
            REQUIRE(size == CAN_MTU);
        else
            check_message(p, &m, (size_t)size);
    if (p->fd >= 0 && (size == 0 || errno != EAGAIN))
        REQUIRE(!p->greeted || plain); /* only who is wrong is turned away */
}

/* ---- The port and the bus -------------------------------------------------------------------- */

static void hand_in(rig *r, const port_frame *frame)
{
    const uint64_t now = cw_bus_now(r->bus.bus);
    if (port_is_shared(r->port)) {
        port_set_time(r->port, now, frame->realtime_ns);
        port_handed_in(r->port, frame);
    }
    if (frame->is_error) /* for other programs alone */
        return;
    fuzz_bus_send(&r->bus, 0, &frame->frame, now);
    r->read++;
}

static bool is_readable(const port *p)
{
    struct pollfd wait = {.fd = port_fd(p), .events = POLLIN};
    return poll(&wait, 1, 0) == 1;
}

static void read_port(rig *r, unsigned max)
{
    port_frame frames[PORT_BATCH];
    bool more = true;
    for (unsigned turn = 0; more || is_readable(r->port); turn++) {
        REQUIRE(turn < TURNS_MAX * PORT_BATCH);
        const unsigned count = port_read(r->port, frames, max, &more);
        REQUIRE(count <= max);
        for (unsigned i = 0; i < count; i++)
            hand_in(r, &frames[i]);
    }
    REQUIRE(r->read == r->sent);
    for (unsigned i = 0; i < PROGRAMS; i++)
        take_messages(&r->programs[i], i == 0);
}

static void take_event(void *user, const cw_event *event)
{
    rig *r = user;
    if (!(event->nodes & 1u))
        return;
    port_set_time(r->port, event->tick, (int64_t)event->tick);
    if (event->kind == CW_EVENT_TX || event->kind == CW_EVENT_DROP)
        port_ended(r->port, event);
    if (event->kind == CW_EVENT_RX) {
        (void)port_write(r->port, &event->frame);
        r->out++;
    }
}

static void advance(rig *r, unsigned bits)
{
    bits = r->bits + bits > BITS_MAX ? BITS_MAX - r->bits : bits;
    r->bits += bits;
    fuzz_bus_advance(&r->bus, cw_bus_now(r->bus.bus) + (uint64_t)bits * BIT_TICKS);
    for (unsigned i = 0; i < PROGRAMS; i++)
        take_messages(&r->programs[i], i == 0);
}

static void open_bus(rig *r)
{
    const cw_node_config nodes[] = {{.queue = 8, .warning_limit = 96},
                                    {.queue = 8, .warning_limit = 96}};
    const cw_bus_config config = {
        .bit_ticks = BIT_TICKS, .node_count = 2, .inbox = 1000, .nodes = nodes};
    REQUIRE(fuzz_bus_open(&r->bus, &config));
    r->bus.take = take_event;
    r->bus.user = r;
}

/* ---- Beginning and end ----------------------------------------------------------------------- */

static char folder[] = "/tmp/canwire-fuzz-XXXXXX"; /* for the socket */

static void remove_folder(void)
{
    (void)rmdir(folder);
}

static void make_folder(void)
{
    static bool made;
    if (made)
        return;
    REQUIRE(mkdtemp(folder) != NULL && atexit(remove_folder) == 0);
    made = true;
}

static void open_port(rig *r)
{
    char error[PORT_ERROR_TEXT_MAX], name[sizeof r->address.sun_path + 10];
    const port_sharing sharing = {.node = "node",
                                  .max = PROGRAMS,
                                  .echo = fuzz_bool(&r->in) ? PORT_ECHO_SENT : PORT_ECHO_AT_ONCE};
    make_folder();
    r->address.sun_family = AF_UNIX;
    (void)snprintf(r->address.sun_path, sizeof r->address.sun_path, "%s/bus", folder);
    (void)snprintf(name, sizeof name, "unix:%s", r->address.sun_path);
    r->port = port_open(name, "bus", error);
    REQUIRE(r->port != NULL);
    port_share(r->port, &sharing);
}

static void operate(rig *r)
{
    const unsigned op = fuzz_below(&r->in, 16);
    const unsigned who = fuzz_below(&r->in, PROGRAMS);
    program *p = &r->programs[who];
    if (op < 5)
        send_frame(r, who);
    else if (op < 7)
        read_port(r, op == 5 ? PORT_BATCH : 1 + fuzz_below(&r->in, PORT_BATCH));
    else if (op < 9)
        advance(r, 4 * fuzz_below(&r->in, 256));
    else if (op == 9)
        port_pushed_back(r->port);
    else if (op == 10 || op == 11) {
        read_port(r, PORT_BATCH); /* a plain ECU that comes before the end of another is refused */
        come(r, who);
        read_port(r, PORT_BATCH);
    } else if (op == 12) {
        read_port(r, PORT_BATCH);
        leave(p);
        read_port(r, PORT_BATCH);
    } else if (who > 0) {
        if (op == 13)
            say_hello(r, p);
        else if (op == 14)
            (fuzz_bool(&r->in) ? set_options : set_filters)(r, p);
        else
            (fuzz_below(&r->in, 4) == 0 ? ask_for_end : write_nonsense)(r, p);
    }
}

static void check_books(rig *r)
{
    port_stats stats;
    cw_node_stats node;
    port_get_stats(r->port, &stats);
    REQUIRE(cw_node_get_stats(r->bus.bus, 0, &node) == CW_OK);
    REQUIRE(stats.read == r->read && node.handed_in + node.inbox == r->read);
    REQUIRE(stats.written + stats.write_failed + stats.unheard == r->out);
    REQUIRE(stats.clients_lost == 0 && stats.unconfirmed == 0 && stats.kernel_dropped == 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static rig r; /* large */
    memset(&r, 0, sizeof r);
    r.in = (fuzz_input){.data = data, .left = size};
    for (unsigned i = 0; i < PROGRAMS; i++)
        r.programs[i].fd = -1;
    open_port(&r);
    open_bus(&r);
    for (unsigned i = 0; r.in.left > 0 && i < OPERATIONS_MAX; i++)
        operate(&r);
    read_port(&r, PORT_BATCH);
    advance(&r, 1000);
    fuzz_bus_check(&r.bus);
    check_books(&r);
    for (unsigned i = 0; i < PROGRAMS; i++)
        leave(&r.programs[i]);
    fuzz_bus_close(&r.bus);
    port_close(r.port);
    return 0;
}
