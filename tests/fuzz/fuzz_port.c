/* SPDX-License-Identifier: MIT
 *
 * fuzz_port.c - messages of any kind from ECUs to their ports, and the reactions of the bus.
 *
 * Two nodes of a bus have ports. "ecu" has a Unix socket with a hostile program at its other end.
 * "can" has a port with made-up messages in the form of a raw CAN socket. Each message is the
 * written frame for the bus, or is counted under its reason. Each output is the same frame in the
 * form of linux/can.h. The counts of ports and bus agree.
 *
 * Input: the kind of socket, modes of the nodes, then operations until it is used up (operate()).
 * The first files in corpus/port were put together by hand, one for each thing that a program may
 * do.
 */
#include "fuzz.h"

#include "port/kind.h"
#include "port/open.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/can/error.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define ECU 0u
#define CAN 1u
#define PORTS 2u
#define NODES 3u
#define BIT_TICKS 160u
#define BITS_MAX 20000u
#define OPERATIONS_MAX 300u
#define MESSAGE_MAX 96u   /* bytes; more than a port has room for */
#define WAITING_MAX 256u  /* messages that have been written and not been read */
#define BURST_MAX 80u     /* more than PORT_BATCH */
#define FDS_PASSED_MAX 24u
#define TURNS_MAX 100u /* of reading, until a port is taken to be one that wakes for nothing */
#define FDS_SEEN 128 /* file descriptors that are looked at */
#define CLASSES_KNOWN 0x3FFu /* of error frames: all bits that linux/can/error.h names */

typedef struct message {
    uint8_t bytes[MESSAGE_MAX];
    size_t size;
    int flags;          /* MSG_CONFIRM, MSG_TRUNC */
    int64_t arrival_ns; /* 0: unknown; -1: sometime */
    bool has_losses;
    uint32_t losses; /* of the kernel so far, as reported with the message */
} message;

/* The expected counters. */
typedef struct counts {
    uint64_t read;
    uint64_t malformed;
    uint64_t errors_ignored;
    uint64_t connected;
    uint64_t refused;
    uint64_t lost;         /* in the kernel, as it counts */
    uint64_t lost_reported; /* ... and has reported */
    uint64_t frames_out;   /* for port_write() ... */
    uint64_t sent_back;    /* ... of them, those that the bus has not carried */
    uint64_t errors_out;   /* for port_write_error() */
    uint64_t overflow_tells; /* of port_tell_overflow() at most */
} counts;

typedef struct side {
    port *port;
    counts counts;
    message waiting[WAITING_MAX]; /* oldest first */
    unsigned count;
} side;

typedef struct rig {
    fuzz_input in;
    fuzz_bus bus;
    unsigned bits;
    uint64_t delay_ticks; /* from now until what is read counts as handed in */
    side sides[PORTS];
    int program; /* the ECU's end; -1: it has none */
    bool at_path;
    struct sockaddr_un address;
    struct canfd_frame captured; /* the last frame sent by the port "can", or its begin */
    size_t captured_size;
    port_sent verdict;         /* on what it sends */
} rig;

static rig *running; /* for the kind of port that is made up */

/* ---- What Linux says a message is ------------------------------------------------------------ */

typedef enum meaning { FRAME, MALFORMED, ERROR_FRAME, OWN } meaning;

static meaning meaning_of(const message *m)
{
    if (m->flags & MSG_CONFIRM)
        return OWN;
    if ((m->flags & MSG_TRUNC) || (m->size != CAN_MTU && m->size != CANFD_MTU))
        return MALFORMED;
    if (m->bytes[4] > (m->size == CAN_MTU ? CAN_MAX_DLEN : CANFD_MAX_DLEN))
        return MALFORMED;
    uint32_t can_id;
    memcpy(&can_id, m->bytes, sizeof can_id);
    return can_id & CAN_ERR_FLAG ? ERROR_FRAME : FRAME;
}

/* Returns the DLC: len8_dlc counts from 9 to 15 only, and with eight bytes. */
static unsigned dlc_of(const struct can_frame *f)
{
    bool raw = f->len == CAN_MAX_DLEN && f->len8_dlc > CAN_MAX_DLEN &&
               f->len8_dlc <= CAN_MAX_RAW_DLC;
    return raw ? f->len8_dlc : f->len;
}

static void check_classic(const cw_frame *got, const message *m)
{
    struct can_frame in;
    memcpy(&in, m->bytes, sizeof in);
    bool extended = in.can_id & CAN_EFF_FLAG;
    uint32_t id = in.can_id & CAN_EFF_MASK;
    REQUIRE(got->id == id && got->dlc == dlc_of(&in));
    REQUIRE(got->flags == ((extended ? CW_FRAME_EXTENDED : 0) |
                           (in.can_id & CAN_RTR_FLAG ? CW_FRAME_REMOTE : 0)));
    REQUIRE(cw_frame_valid(got) == (extended || id <= CAN_SFF_MASK));
    unsigned length = cw_frame_length(got);
    for (unsigned i = 0; i < CW_FRAME_DATA_MAX; i++)
        REQUIRE(got->data[i] == (i < length ? in.data[i] : 0));
}

/* The writer's ESI does not count; the DLC is the least with room, filled with zeros. */
static void check_fd(const cw_frame *got, const message *m)
{
    struct canfd_frame in;
    memcpy(&in, m->bytes, sizeof in);
    bool extended = in.can_id & CAN_EFF_FLAG, remote = in.can_id & CAN_RTR_FLAG;
    REQUIRE(got->id == (in.can_id & CAN_EFF_MASK));
    REQUIRE(got->flags == (CW_FRAME_FD | (in.flags & CANFD_BRS ? CW_FRAME_BRS : 0) |
                           (extended ? CW_FRAME_EXTENDED : 0) | (remote ? CW_FRAME_REMOTE : 0)));
    REQUIRE(cw_frame_valid(got) == (!remote && (extended || got->id <= CAN_SFF_MASK)));
    static const unsigned lengths[] = {0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64};
    REQUIRE(got->dlc < 16 && lengths[got->dlc] >= in.len);
    REQUIRE(got->dlc == 0 || lengths[got->dlc - 1] < in.len);
    for (unsigned i = 0; !remote && i < CW_FRAME_DATA_MAX; i++)
        REQUIRE(got->data[i] == (i < in.len ? in.data[i] : 0));
}

static void check_read(const port_frame *got, const message *m)
{
    REQUIRE(m->arrival_ns < 0 ? got->realtime_ns > 0 : got->realtime_ns == m->arrival_ns);
    if (m->size == CANFD_MTU)
        check_fd(&got->frame, m); /* a classical bus drops and counts it */
    else
        check_classic(&got->frame, m);
}

static void check_out_error(const struct can_frame *out)
{
    uint32_t classes = out->can_id & CAN_ERR_MASK;
    REQUIRE((out->can_id & ~CAN_ERR_MASK) == CAN_ERR_FLAG);
    REQUIRE(classes != 0 && (classes & ~CLASSES_KNOWN) == 0);
    REQUIRE(out->len == CAN_ERR_DLC && out->len8_dlc == 0);
}

/* Checks that all bytes that an ECU reads are defined. */
static void check_out(const struct can_frame *out)
{
    bool extended = out->can_id & CAN_EFF_FLAG;
    uint32_t id = out->can_id & CAN_EFF_MASK;
    REQUIRE(out->__pad == 0 && out->__res0 == 0);
    if (out->can_id & CAN_ERR_FLAG) {
        check_out_error(out);
        return;
    }
    REQUIRE(extended || id <= CAN_SFF_MASK);
    REQUIRE(out->len <= CAN_MAX_DLEN && out->len8_dlc <= CAN_MAX_RAW_DLC);
    REQUIRE(out->len8_dlc == 0 || (out->len == CAN_MAX_DLEN && out->len8_dlc > CAN_MAX_DLEN));
    unsigned length = out->can_id & CAN_RTR_FLAG ? 0 : out->len;
    for (unsigned i = length; i < CAN_MAX_DLEN; i++)
        REQUIRE(out->data[i] == 0);
}

/* ---- A port as on a raw CAN socket ----------------------------------------------------------- */

static struct cmsghdr *add_control(struct msghdr *header, int type, const void *value, size_t size)
{
    struct cmsghdr *c = (struct cmsghdr *)((char *)header->msg_control + header->msg_controllen);
    *c = (struct cmsghdr){
        .cmsg_level = SOL_SOCKET, .cmsg_type = type, .cmsg_len = CMSG_LEN(size)};
    memcpy(CMSG_DATA(c), value, size);
    header->msg_controllen += CMSG_SPACE(size);
    return c;
}

static void add_stamp(struct msghdr *header, int64_t ns)
{
    const struct timespec time = {.tv_sec = ns / 1000000000, .tv_nsec = ns % 1000000000};
    if (ns != 0)
        (void)add_control(header, SCM_TIMESTAMPNS, &time, sizeof time);
}

static void put_message(port *p, unsigned i, const message *m)
{
    struct mmsghdr *out = &p->messages.headers[i];
    size_t room = sizeof p->messages.frames[i];
    memcpy(&p->messages.frames[i], m->bytes, m->size < room ? m->size : room);
    out->msg_len = (unsigned)(m->size < room ? m->size : room);
    out->msg_hdr.msg_flags = m->flags;
    out->msg_hdr.msg_control = p->messages.controls[i];
    out->msg_hdr.msg_controllen = 0;
    add_stamp(&out->msg_hdr, m->arrival_ns);
    if (m->has_losses)
        (void)add_control(&out->msg_hdr, SO_RXQ_OVFL, &m->losses, sizeof m->losses);
}

/* Reads the made-up messages, which are one batch. */
static unsigned read_made_up(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more)
{
    const side *s = &running->sides[CAN];
    REQUIRE(s->count <= max);
    for (unsigned i = 0; i < s->count; i++)
        put_message(p, i, &s->waiting[i]);
    *more = false;
    return port_take(p, frames, (int)s->count);
}

static port_sent capture(port *p, const void *frame, size_t size)
{
    (void)p;
    REQUIRE(size == CAN_MTU || size == CANFD_MTU);
    if (size == CAN_MTU)
        check_out(frame);
    memcpy(&running->captured, frame, size);
    running->captured_size = size;
    return running->verdict;
}

static void close_made_up(port *p)
{
    free(p);
}

static const port_kind made_up = {.close = close_made_up,
                                  .read = read_made_up,
                                  .send = capture,
                                  .control_bytes = PORT_CONTROL_BYTES};

static void check_fd_sent(const struct canfd_frame *out, const cw_frame *frame)
{
    const unsigned length = cw_frame_length(frame);
    REQUIRE((out->can_id & CAN_EFF_MASK) == frame->id && out->len == length);
    REQUIRE(out->flags == (CANFD_FDF | (frame->flags & CW_FRAME_BRS ? CANFD_BRS : 0)));
    REQUIRE(out->__res0 == 0 && out->__res1 == 0);
    for (unsigned i = 0; i < CANFD_MAX_DLEN; i++)
        REQUIRE(out->data[i] == (i < length ? frame->data[i] : 0));
}

/* Writes the frame back: its content is the same, and meaningless bytes are gone. */
static void send_back(rig *r, const cw_frame *frame, const message *m)
{
    side *s = &r->sides[CAN];
    struct can_frame in, out;
    if (!cw_frame_valid(frame))
        return;
    (void)port_write(s->port, frame);
    s->counts.frames_out++;
    s->counts.sent_back++;
    REQUIRE(r->captured_size == m->size);
    if (frame->flags & CW_FRAME_FD) {
        check_fd_sent(&r->captured, frame);
        return;
    }
    memcpy(&in, m->bytes, sizeof in);
    memcpy(&out, &r->captured, sizeof out);
    REQUIRE(out.can_id == in.can_id && out.len == in.len);
    REQUIRE(dlc_of(&out) == dlc_of(&in));
    REQUIRE(memcmp(out.data, in.data, cw_frame_length(frame)) == 0);
}

/* ---- Reading --------------------------------------------------------------------------------- */

/* Skips messages that came before the next frame. */
static void pass_over(side *s, unsigned *next)
{
    for (; *next < s->count; ++*next) {
        meaning what = meaning_of(&s->waiting[*next]);
        if (what == FRAME)
            return;
        s->counts.malformed += what == MALFORMED;
        s->counts.errors_ignored += what == ERROR_FRAME;
    }
}

static void hand_in(rig *r, unsigned node, const cw_frame *frame)
{
    fuzz_bus_send(&r->bus, node, frame, cw_bus_now(r->bus.bus) + r->delay_ticks);
}

static void check_counters(const side *s)
{
    port_stats got;
    const counts *want = &s->counts;
    port_get_stats(s->port, &got);
    REQUIRE(got.read == want->read);
    REQUIRE(got.malformed == want->malformed && got.errors_ignored == want->errors_ignored);
    REQUIRE(got.connected == want->connected && got.refused == want->refused);
    REQUIRE(got.kernel_dropped == want->lost_reported);
    REQUIRE(got.written + got.write_failed + got.unheard == want->frames_out);
    uint64_t errors =
        got.errors_written + got.errors_failed + got.errors_left_out + got.errors_unheard;
    REQUIRE(errors >= want->errors_out && errors - want->errors_out <= want->overflow_tells);
}

/* Returns true when a port would wake the loop of a daemon. */
static bool is_readable(const port *p)
{
    struct pollfd wait = {.fd = port_fd(p), .events = POLLIN};
    return wait.fd >= 0 && poll(&wait, 1, 0) == 1;
}

/* Reads all waiting frames: exactly the written ones, in that order. */
static void read_all(rig *r, unsigned node)
{
    side *s = &r->sides[node];
    port_frame frames[PORT_BATCH];
    unsigned next = 0;
    bool more = true;
    for (unsigned turn = 0; more || is_readable(s->port); turn++) {
        REQUIRE(turn < TURNS_MAX);
        unsigned count = port_read(s->port, frames, PORT_BATCH, &more);
        REQUIRE(count <= PORT_BATCH);
        for (unsigned i = 0; i < count; i++) {
            pass_over(s, &next);
            REQUIRE(next < s->count);
            check_read(&frames[i], &s->waiting[next]);
            if (node == CAN)
                send_back(r, &frames[i].frame, &s->waiting[next]);
            hand_in(r, node, &frames[i].frame);
            s->counts.read++;
            next++;
        }
    }
    pass_over(s, &next);
    REQUIRE(next == s->count);
    s->count = 0;
    check_counters(s);
}

/* ---- Messages -------------------------------------------------------------------------------- */

/* Makes a message, a frame more often than not. */
static message make_message(fuzz_input *in)
{
    message m = {.arrival_ns = -1};
    unsigned kind = fuzz_u8(in);
    m.size = kind < 160 ? CAN_MTU : kind < 180 ? CANFD_MTU : fuzz_below(in, MESSAGE_MAX + 1);
    size_t given = m.size < CAN_MTU || kind >= 180 ? m.size : CAN_MTU;
    for (size_t i = 0; i < given; i++)
        m.bytes[i] = fuzz_u8(in);
    uint32_t can_id;
    memcpy(&can_id, m.bytes, sizeof can_id);
    if (kind < 128)
        can_id &= ~CAN_ERR_FLAG & (can_id & CAN_EFF_FLAG ? UINT32_MAX : ~0x1FFFF800u);
    memcpy(m.bytes, &can_id, sizeof can_id);
    if (kind < 128)
        m.bytes[4] &= 15u;
    return m;
}

static void keep(side *s, const message *m)
{
    REQUIRE(s->count < WAITING_MAX);
    s->waiting[s->count++] = *m;
}

/* Adds losses. The number beside a message may be older than the last reported one. It counts
 * modulo 2^32: no more than half of that can be lost until it is reported. */
static void add_losses(rig *r, message *m)
{
    counts *c = &r->sides[CAN].counts;
    unsigned how = fuzz_u8(&r->in);
    uint64_t more = how & 2u ? fuzz_u32(&r->in) : how >> 6;
    if (c->lost + more - c->lost_reported <= INT32_MAX)
        c->lost += more;
    uint64_t told = how & 4u && c->lost >= 9 ? c->lost - 9 : c->lost;
    m->has_losses = how & 1u;
    m->losses = (uint32_t)told;
    if (m->has_losses && told > c->lost_reported)
        c->lost_reported = told;
}

/* Receives a batch from the kernel. */
static void receive(rig *r)
{
    unsigned count = 1 + fuzz_below(&r->in, PORT_BATCH);
    message m = {.size = 0};
    for (unsigned i = 0; i < count; i++) {
        unsigned how = fuzz_u8(&r->in);
        if (i == 0 || (how & 3u))
            m = make_message(&r->in);
        m.flags = (how >> 2 & 7u) == 7 ? MSG_CONFIRM : (how >> 5) == 7 ? MSG_TRUNC : 0;
        m.arrival_ns = how >> 5 & 1u ? (int64_t)fuzz_u32(&r->in) * 1000000007 : 0;
        if (m.size > sizeof(struct canfd_frame))
            m.flags |= MSG_TRUNC;
        add_losses(r, &m);
        keep(&r->sides[CAN], &m);
    }
    read_all(r, CAN);
}

/* ---- The program at the socket --------------------------------------------------------------- */

static void hang_up(rig *r)
{
    if (r->program >= 0)
        REQUIRE(close(r->program) == 0);
    r->program = -1;
}

static int connect_to(const rig *r)
{
    int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    REQUIRE(fd >= 0);
    REQUIRE(connect(fd, (const struct sockaddr *)&r->address, sizeof r->address) == 0);
    return fd;
}

/* Connects an ECU. The one before has gone, or stays and this one is refused. */
static void come(rig *r)
{
    side *s = &r->sides[ECU];
    char byte;
    if (!r->at_path)
        return;
    if (r->program < 0) {
        if (fuzz_bool(&r->in))
            read_all(r, ECU);
        r->program = connect_to(r);
        s->counts.connected++;
    } else {
        read_all(r, ECU); /* a port looks for others when it has read all */
        int fd = connect_to(r);
        (void)send(fd, "nobody reads it", CAN_MTU, MSG_NOSIGNAL);
        s->counts.refused++;
        read_all(r, ECU);
        REQUIRE(recv(fd, &byte, 1, 0) <= 0 && errno != EAGAIN);
        REQUIRE(close(fd) == 0);
    }
    read_all(r, ECU);
}

/* Returns true when the kernel takes the message. passed: number of unrequested file descriptors
 * with it. */
static bool send_message(const rig *r, const message *m, unsigned passed)
{
    _Alignas(struct cmsghdr) char control[CMSG_SPACE(FDS_PASSED_MAX * sizeof(int))] = {0};
    struct iovec vector = {.iov_base = (void *)(uintptr_t)m->bytes, .iov_len = m->size};
    struct msghdr header = {.msg_iov = &vector, .msg_iovlen = 1};
    if (passed > 0) {
        int fds[FDS_PASSED_MAX];
        for (unsigned i = 0; i < passed; i++)
            fds[i] = r->program;
        header.msg_control = control;
        (void)add_control(&header, SCM_RIGHTS, fds, passed * sizeof *fds);
    }
    return sendmsg(r->program, &header, MSG_NOSIGNAL | MSG_DONTWAIT) >= 0;
}

static void write_messages(rig *r, unsigned count, unsigned passed)
{
    side *s = &r->sides[ECU];
    const message m = make_message(&r->in);
    for (unsigned i = 0; r->program >= 0 && i < count && s->count < WAITING_MAX; i++)
        if (send_message(r, &m, passed))
            keep(s, &m);
}

/* Reads messages of the port, and may write them back: each is a frame, or an error frame that is
 * ignored. */
static void take_messages(rig *r, unsigned count, bool echo)
{
    message m = {.arrival_ns = -1};
    for (unsigned i = 0; r->program >= 0 && i < count; i++) {
        ssize_t size = recv(r->program, m.bytes, sizeof m.bytes, 0);
        if (size <= 0)
            return;
        struct can_frame out;
        REQUIRE(size == sizeof out);
        memcpy(&out, m.bytes, sizeof out);
        check_out(&out);
        m.size = CAN_MTU;
        REQUIRE(meaning_of(&m) == (out.can_id & CAN_ERR_FLAG ? ERROR_FRAME : FRAME));
        if (echo && r->sides[ECU].count < WAITING_MAX && send_message(r, &m, 0))
            keep(&r->sides[ECU], &m);
    }
}

/* Ends an ECU: it hangs up, or stays and no longer sends or receives. */
static void leave(rig *r, unsigned how)
{
    static const int hows[] = {SHUT_RD, SHUT_WR, SHUT_RDWR};
    if (how < 3 && r->program >= 0)
        REQUIRE(shutdown(r->program, hows[how]) == 0);
    if (how == 0)
        return;
    if (how < 3)
        read_all(r, ECU);
    hang_up(r);
}

/* Sets the result of the next frames of the port "can", and reports losses. */
static void tell(rig *r, unsigned how)
{
    side *s = &r->sides[CAN];
    r->verdict = (port_sent)(how % PORT_SENT_COUNT);
    port_report_overflow(s->port, cw_bus_now(r->bus.bus));
    s->counts.overflow_tells++;
}

/* ---- The bus --------------------------------------------------------------------------------- */

/* Delivers an event as the engine does. */
static void deliver(rig *r, unsigned node, const cw_event *event)
{
    side *s = &r->sides[node];
    errframe error;
    cw_settings settings;
    REQUIRE(cw_node_get_settings(r->bus.bus, node, &settings) == CW_OK);
    if (event->kind == CW_EVENT_RX) {
        (void)port_write(s->port, &event->frame);
        s->counts.frames_out++;
    } else if (errframe_from_event(&error, event, settings.modes, ERRFRAME_ANY)) {
        (void)port_write_error(s->port, &error, event->tick);
        s->counts.errors_out++;
    }
}

static void take_event(void *user, const cw_event *event)
{
    rig *r = user;
    for (unsigned i = 0; i < PORTS; i++)
        if (event->nodes >> i & 1u)
            deliver(r, i, event);
}

static void advance(rig *r, unsigned bits)
{
    if (r->bits + bits > BITS_MAX)
        bits = BITS_MAX - r->bits;
    r->bits += bits;
    fuzz_bus_advance(&r->bus, cw_bus_now(r->bus.bus) + (uint64_t)bits * BIT_TICKS);
}

/* A rule that is armed by hand: an error in a frame; nodes that are bus-off, and passive. */
static const cw_rule rules[] = {
    {.name = "bit",
     .manual = true,
     .trigger = CW_TRIGGER_FRAME,
     .time_end = CW_NEVER,
     .probability = UINT64_MAX,
     .action = CW_ACTION_FLIP,
     .field = CW_FIELD_CRC,
     .bits = 1},
    {.name = "off",
     .manual = true,
     .trigger = CW_TRIGGER_ARMED,
     .time_end = CW_NEVER,
     .probability = UINT64_MAX,
     .action = CW_ACTION_BUS_OFF,
     .nodes = 1u << ECU},
    {.name = "passive",
     .manual = true,
     .trigger = CW_TRIGGER_ARMED,
     .time_end = CW_NEVER,
     .probability = UINT64_MAX,
     .action = CW_ACTION_COUNTERS,
     .nodes = 1u << ECU | 1u << CAN,
     .tec = 130,
     .rec = CW_KEEP},
};

#define RULES (sizeof rules / sizeof rules[0])

static void disturb(rig *r)
{
    unsigned what = fuzz_u8(&r->in);
    unsigned node = what >> 4 & 1u;
    if (what % 5 == 0)
        (void)cw_node_attach(r->bus.bus, node, what & 4u);
    else if (what % 5 == 1)
        (void)cw_node_restart(r->bus.bus, node);
    else
        REQUIRE(cw_bus_fire_rule(r->bus.bus, what % 5 - 2) != CW_INVALID);
    fuzz_bus_poll(&r->bus);
}

static void open_bus(rig *r)
{
    cw_node_config nodes[NODES];
    for (unsigned i = 0; i < NODES; i++)
        nodes[i] = (cw_node_config){.modes = (uint8_t)fuzz_below(&r->in, 32),
                                    .queue = (uint16_t)(1 + fuzz_below(&r->in, 20)),
                                    .warning_limit = 96,
                                    .restart_ticks = fuzz_bool(&r->in) ? 100 * BIT_TICKS : 0};
    const cw_bus_config config = {.bit_ticks = BIT_TICKS,
                                  .node_count = NODES,
                                  .inbox = (uint16_t)(1 + fuzz_below(&r->in, 40)),
                                  .rule_count = RULES,
                                  .nodes = nodes,
                                  .rules = rules};
    REQUIRE(fuzz_bus_open(&r->bus, &config));
    r->bus.take = take_event;
    r->bus.user = r;
}

/* Checks that all read frames are on the bus, and all frames of the bus in the counts of the
 * ports. */
static void check_books(const rig *r)
{
    for (unsigned i = 0; i < PORTS; i++) {
        cw_node_stats node;
        const counts *c = &r->sides[i].counts;
        check_counters(&r->sides[i]);
        REQUIRE(cw_node_get_stats(r->bus.bus, i, &node) == CW_OK);
        REQUIRE(node.handed_in + node.inbox == c->read);
        REQUIRE(node.rx_frames + c->sent_back == c->frames_out);
    }
}

/* ---- Beginning and end ----------------------------------------------------------------------- */

static char folder[] = "/tmp/canwire-fuzz-XXXXXX"; /* for sockets at paths */

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

static port *open_or_fail(const char *name)
{
    char error[PORT_ERROR_TEXT_MAX];
    port *p = port_open(name, "bus", error);
    REQUIRE(p != NULL);
    return p;
}

static void open_path(rig *r)
{
    char name[sizeof r->address.sun_path + 10];
    make_folder();
    r->address.sun_family = AF_UNIX;
    (void)snprintf(r->address.sun_path, sizeof r->address.sun_path, "%s/ecu", folder);
    (void)snprintf(name, sizeof name, "unix:%s", r->address.sun_path);
    r->sides[ECU].port = open_or_fail(name);
}

static void open_pair(rig *r)
{
    char name[20];
    int ends[2];
    REQUIRE(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends) == 0);
    (void)snprintf(name, sizeof name, "fd:%d", ends[0]);
    r->sides[ECU].port = open_or_fail(name);
    r->sides[ECU].counts.connected = 1;
    r->program = ends[1];
    REQUIRE(fcntl(r->program, F_SETFL, O_NONBLOCK) == 0);
}

static void open_ports(rig *r)
{
    r->program = -1;
    r->at_path = fuzz_u8(&r->in) % 4 == 3;
    if (r->at_path)
        open_path(r);
    else
        open_pair(r);
    r->sides[CAN].port = port_new(&made_up, sizeof(port));
    REQUIRE(r->sides[CAN].port != NULL);
    running = r;
}

static unsigned count_descriptors(void)
{
    unsigned count = 0;
    for (int fd = 0; fd < FDS_SEEN; fd++)
        count += fcntl(fd, F_GETFD) >= 0;
    return count;
}

static void operate(rig *r)
{
    unsigned op = fuzz_u8(&r->in) % 16;
    if (op < 3)
        write_messages(r, 1, 0);
    else if (op == 3)
        write_messages(r, 1 + fuzz_below(&r->in, BURST_MAX), 0);
    else if (op == 4)
        write_messages(r, 1, 1 + fuzz_below(&r->in, FDS_PASSED_MAX));
    else if (op == 5)
        read_all(r, ECU);
    else if (op == 6)
        r->delay_ticks = fuzz_below(&r->in, 64) * (BIT_TICKS / 2);
    else if (op < 9)
        receive(r);
    else if (op == 9)
        take_messages(r, 1 + fuzz_below(&r->in, 64), fuzz_bool(&r->in));
    else if (op < 12)
        advance(r, 4 * fuzz_below(&r->in, 256));
    else if (op == 12)
        disturb(r);
    else if (op == 13)
        come(r);
    else if (op == 14)
        leave(r, fuzz_below(&r->in, 4));
    else
        tell(r, fuzz_u8(&r->in));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static rig r; /* large */
    unsigned descriptors = count_descriptors();
    memset(&r, 0, sizeof r);
    r.in = (fuzz_input){.data = data, .left = size};
    open_ports(&r);
    open_bus(&r);
    for (unsigned i = 0; r.in.left > 0 && i < OPERATIONS_MAX; i++)
        operate(&r);
    hang_up(&r);
    read_all(&r, ECU);
    advance(&r, 1000);
    fuzz_bus_check(&r.bus);
    check_books(&r);
    fuzz_bus_close(&r.bus);
    for (unsigned i = 0; i < PORTS; i++)
        port_close(r.sides[i].port);
    REQUIRE(count_descriptors() == descriptors);
    return 0;
}
