/* SPDX-License-Identifier: MIT
 *
 * socketcand.c - a program at a port that speaks the protocol of socketcand.
 *
 * The protocol is that of doc/protocol.md of socketcand, with what its version of 2024 has beyond
 * that (CAN FD). Messages are texts in angle brackets, so a half one is kept here until its rest
 * comes. Whole ones stay in the socket until they are read, one by one. So a program waits when the
 * node's queue is full, and each frame has the time stamp of its own segment.
 */
#include "port/tunnel/socketcand.h"

#include "base/moment.h"
#include "base/text/chars.h"
#include "base/text/number.h"
#include "port/shared.h"
#include "port/tunnel/broadcast.h"

#include <arpa/inet.h>
#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <netinet/in.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define LINE_BYTES 512u  /* the longest command, fdsend, has 220 */
#define OUT_BYTES 320u   /* the longest answer, a CAN FD frame of BCM mode, has 240 */
#define HELD_BYTES 65536u /* frames that are held back after a change of mode ... */
#define HELD_NS INT64_C(50000000) /* ... for so long */
#define WORDS_MAX 80u
#define BUS_BYTES 33u
#define DRAINS_MAX 64u
#define LOST_BYTES 16384u /* of one read of what a program has left behind */
#define NS_PER_S INT64_C(1000000000)
#define NS_PER_US INT64_C(1000)
#define NS_PER_MS INT64_C(1000000)
#define SECONDS_MAX 1000000u

/* The modes of the protocol, as a set. */
typedef enum talk_mode {
    NO_BUS = 1,
    BCM = 2,
    RAW = 4,
    CONTROL = 8
} talk_mode;

typedef struct talk {
    talk_mode mode;
    bool fd;               /* the node knows CAN FD */
    char bus[BUS_BYTES];
    char line[LINE_BYTES]; /* the start of a command, from its '<' on */
    size_t line_bytes;
    bool garbage;          /* bytes that are not commands have been counted */
    char rest[OUT_BYTES];  /* the end of a message that the socket had no room for */
    size_t rest_bytes;
    char *held;            /* frames that are held back; NULL: none is */
    size_t held_bytes;
    int64_t held_ns;       /* until then, CLOCK_MONOTONIC; 0: no longer */
    broadcast broadcast;
    bool job_read;         /* the last message was a frame of a job */
    int64_t statistics_ns; /* interval; 0: off */
    int64_t next_statistics_ns;
} talk;

static talk *talk_of(const member *c)
{
    return c->more;
}

const char *socketcand_bus(const member *c)
{
    return talk_of(c)->bus;
}

/* ---- To the program -------------------------------------------------------------------------- */

/* Sends the end of a message that has begun. Returns true when nothing of it is left. */
static bool socketcand_flush(member *c)
{
    talk *t = talk_of(c);
    if (t->rest_bytes == 0)
        return true;
    const ssize_t sent = send(c->fd, t->rest, t->rest_bytes, MSG_DONTWAIT | MSG_NOSIGNAL);
    if (sent < 0)
        return false;
    t->rest_bytes -= (size_t)sent;
    memmove(t->rest, t->rest + sent, t->rest_bytes);
    c->stuck = t->rest_bytes > 0;
    errno = EAGAIN;
    return !c->stuck;
}

/* Sends a message. One that there is no room for is lost, and counted. */
static bool socketcand_put(member *c, const char *text, size_t bytes)
{
    talk *t = talk_of(c);
    const bool free = socketcand_flush(c);
    const ssize_t sent = free ? send(c->fd, text, bytes, MSG_DONTWAIT | MSG_NOSIGNAL) : -1;
    if (sent < 0) {
        c->lost += errno != EPIPE && errno != ECONNRESET && errno != ENOTCONN;
        return false;
    }
    t->rest_bytes = bytes - (size_t)sent;
    memcpy(t->rest, text + sent, t->rest_bytes);
    c->stuck = t->rest_bytes > 0;
    return true;
}

/* Sends what has been held back. */
static void release_held(member *c)
{
    talk *t = talk_of(c);
    size_t at = 0;
    t->held_ns = 0;
    for (size_t i = 0; i < t->held_bytes; i++) {
        if (t->held[i] != '>')
            continue;
        if (!socketcand_put(c, t->held + at, i + 1 - at))
            c->written--;
        at = i + 1;
    }
    free(t->held);
    t->held = NULL;
    t->held_bytes = 0;
}

/* Sends a frame, or holds it back. python-can, which has asked for a mode, takes the answer for a
 * wrong one when it reads a frame in the same piece. */
static bool put_or_hold(member *c, const char *text, size_t bytes)
{
    talk *t = talk_of(c);
    if (t->held_ns == 0)
        return socketcand_put(c, text, bytes);
    if (!t->held)
        t->held = malloc(HELD_BYTES);
    if (!t->held || t->held_bytes + bytes > HELD_BYTES) {
        c->lost++;
        return false;
    }
    memcpy(t->held + t->held_bytes, text, bytes);
    t->held_bytes += bytes;
    return true;
}

__attribute__((format(printf, 2, 3))) static void say(member *c, const char *format, ...)
{
    char text[OUT_BYTES];
    va_list values;
    va_start(values, format);
    const int bytes = vsnprintf(text, sizeof text, format, values);
    va_end(values);
    if (bytes > 0 && (size_t)bytes < sizeof text)
        (void)socketcand_put(c, text, (size_t)bytes);
}

/* Appends to a text of OUT_BYTES, and to its length. */
#define ADD(...) (used = chars_print(text, OUT_BYTES, used, __VA_ARGS__))

/* Sends a frame. Its bytes are apart in BCM mode, and together in RAW mode, as those of socketcand
 * are. An error frame has its class, and no data. */
static bool put_frame(member *c, const struct canfd_frame *frame, size_t size, int64_t realtime_ns)
{
    char text[OUT_BYTES];
    size_t used = 0;
    const bool error = frame->can_id & CAN_ERR_FLAG;
    const bool remote = !error && (frame->can_id & CAN_RTR_FLAG);
    if (error) {
        ADD("< error %03X ", frame->can_id & CAN_ERR_MASK);
    } else {
        ADD(remote ? "< rtr " : size == CANFD_MTU ? "< fdframe " : "< frame ");
        if (frame->can_id & CAN_EFF_FLAG)
            ADD("%08X ", frame->can_id & CAN_EFF_MASK);
        else
            ADD("%03X ", frame->can_id & CAN_SFF_MASK);
    }
    if (size == CANFD_MTU)
        ADD("%02X ", frame->flags);
    ADD("%" PRId64 ".%06" PRId64 " ", realtime_ns / NS_PER_S, realtime_ns % NS_PER_S / NS_PER_US);
    if (remote)
        ADD("%u ", frame->len);
    for (unsigned i = 0; !remote && !error && i < frame->len; i++)
        ADD(talk_of(c)->mode == BCM ? "%02X " : "%02X", frame->data[i]);
    ADD(error || remote ? ">" : " >");
    return put_or_hold(c, text, used);
}

/* Sets when the program must be seen to next: a frame of its jobs, its statistics, or a frame that
 * it has to get late. */
static void set_wake(member *c)
{
    const talk *t = talk_of(c);
    c->wake_ns = broadcast_next_ns(&t->broadcast);
    if (t->statistics_ns > 0 && (c->wake_ns == 0 || t->next_statistics_ns < c->wake_ns))
        c->wake_ns = t->next_statistics_ns;
    if (t->held_ns != 0 && (c->wake_ns == 0 || t->held_ns < c->wake_ns))
        c->wake_ns = t->held_ns;
}

/* Returns true when a program gets a frame: in raw mode all of them, else those of its
 * subscriptions. Broadcast mode knows no CAN FD. */
static bool takes(const member *c, const void *frame, size_t size)
{
    const talk *t = talk_of(c);
    canid_t id;
    memcpy(&id, frame, sizeof id);
    if (t->mode == RAW)
        return size == CAN_MTU || t->fd;
    return t->mode == BCM && size == CAN_MTU && broadcast_wants(&t->broadcast, id);
}

/* Gives a frame to a program. In broadcast mode a subscription may leave it out, or hold it back
 * until its interval is over. */
static bool socketcand_send_frame(member *c, const message_head *head, const void *frame,
                                  size_t size)
{
    talk *t = talk_of(c);
    struct canfd_frame copy = {.can_id = 0};
    struct can_frame classical;
    const int64_t realtime_ns = (int64_t)head->realtime_ns;
    memcpy(&copy, frame, size);
    memcpy(&classical, &copy, sizeof classical);
    if (t->mode == RAW)
        return put_frame(c, &copy, size, realtime_ns);
    const bool passes = broadcast_passes(&t->broadcast, &classical, realtime_ns,
                                         clock_ns(CLOCK_MONOTONIC));
    set_wake(c);
    return passes && put_frame(c, &copy, size, realtime_ns);
}

static void socketcand_tell(member *c, const message_head *head, int code, const char *text)
{
    (void)head;
    (void)code;
    say(c, "< error %s >", text);
}

/* Enters a mode. In BCM mode a program gets its own frames back, as from the kernel's broadcast
 * manager; in RAW mode it does not. */
static void enter(member *c, talk_mode mode)
{
    talk *t = talk_of(c);
    broadcast_free(&t->broadcast); /* its socket is closed, in the terms of socketcand */
    t->mode = mode;
    t->statistics_ns = 0;
    t->held_ns = clock_ns(CLOCK_MONOTONIC) + HELD_NS;
    c->options = MESSAGE_LOOPBACK | (t->fd ? MESSAGE_FD : 0) | (mode == BCM ? MESSAGE_RECV_OWN : 0);
    set_wake(c);
}

/* The kernel bounds what waits. The program has gone, so no more comes. */
static uint64_t socketcand_lose(member *c)
{
    char bytes[LOST_BYTES];
    uint64_t count = 0;
    ssize_t size;
    while ((size = recv(c->fd, bytes, sizeof bytes, MSG_DONTWAIT)) > 0)
        for (const char *end = bytes; (end = memchr(end, '>', (size_t)(bytes + size - end))); end++)
            count++;
    return count;
}

/* Lets a program in, which begins in broadcast mode, as with socketcand. */
static void welcome(member *c, const char *node, bool fd)
{
    (void)node;
    talk_of(c)->fd = fd;
    enter(c, BCM);
    say(c, "< ok >");
}

/* ---- Words of a command ---------------------------------------------------------------------- */

typedef struct command {
    char *words[WORDS_MAX]; /* the name, and what follows */
    unsigned count;
    int64_t realtime_ns;
} command;

/* Reads digits of a base up to a limit. */
static bool socketcand_read_number(uint64_t *out, const char *word, int base, uint64_t max)
{
    const char *digits = word + strspn(word, "0");
    uint32_t hex = 0;
    if (base == 10)
        return text_take_digits(out, &word, max) && !*word;
    if (!text_parse_hex(&hex, digits, strlen(digits)) && (*digits || digits == word))
        return false;
    *out = hex;
    return hex <= max;
}

/* Reads an identifier: eight digits make an extended one. */
static bool socketcand_read_id(canid_t *id, const char *word)
{
    const bool extended = strlen(word) == 8;
    uint64_t number;
    if (!socketcand_read_number(&number, word, 16, extended ? CAN_EFF_MASK : CAN_SFF_MASK))
        return false;
    *id = (canid_t)number | (extended ? CAN_EFF_FLAG : 0);
    return true;
}

/* Reads seconds and microseconds. */
static bool read_interval(int64_t *ns, char *const words[2])
{
    uint64_t seconds, microseconds;
    if (!socketcand_read_number(&seconds, words[0], 10, SECONDS_MAX) ||
        !socketcand_read_number(&microseconds, words[1], 10, UINT32_MAX))
        return false;
    *ns = (int64_t)seconds * NS_PER_S + (int64_t)microseconds * NS_PER_US;
    return true;
}

/* Reads a length and as many bytes, which are the last words. */
static bool socketcand_read_data(uint8_t *len, uint8_t *data, unsigned max, const command *in,
                                 unsigned at)
{
    uint64_t length, byte;
    if (at >= in->count || !socketcand_read_number(&length, in->words[at], 10, max) ||
        in->count != at + 1 + length)
        return false;
    *len = (uint8_t)length;
    for (unsigned i = 0; i < length; i++) {
        if (!socketcand_read_number(&byte, in->words[at + 1 + i], 16, UINT8_MAX))
            return false;
        data[i] = (uint8_t)byte;
    }
    return true;
}

/* Reads identifier, length and bytes. */
static bool socketcand_read_frame(struct can_frame *frame, const command *in, unsigned at)
{
    *frame = (struct can_frame){.can_id = 0};
    return at < in->count && socketcand_read_id(&frame->can_id, in->words[at]) &&
           socketcand_read_data(&frame->len, frame->data, CAN_MAX_DLEN, in, at + 1);
}

/* ---- Commands -------------------------------------------------------------------------------- */

/* Counts a command that is wrong, and says so. */
static member_result socketcand_complain(member *c, port *p, const char *what)
{
    p->stats.malformed++;
    say(c, "< error %s >", what);
    return MEMBER_CONTROL;
}

static member_result wrong(member *c, port *p, const command *in)
{
    char text[80];
    (void)snprintf(text, sizeof text, "syntax error in %.16s command", in->words[0]);
    return socketcand_complain(c, p, text);
}

/* Hands a frame in. */
static member_result hand_in(member *c, port *p, const void *frame, size_t size,
                             int64_t realtime_ns, port_frame *out)
{
    struct canfd_frame copy;
    memcpy(&copy, frame, size);
    if (!port_take_frame(p, out, &copy, size))
        return MEMBER_CONTROL;
    out->realtime_ns = realtime_ns;
    out->number = 0;
    out->client = c->id;
    out->options = c->options;
    c->read += !out->is_error;
    return MEMBER_FRAME;
}

/* `open BUS` makes the program wait for a place. A name that is too long becomes one that no bus
 * has. */
static member_result do_open(member *c, port *p, const command *in, port_frame *out)
{
    (void)out;
    talk *t = talk_of(c);
    if (in->count != 2)
        return wrong(c, p, in);
    const bool fits = strlen(in->words[1]) < sizeof t->bus;
    (void)snprintf(t->bus, sizeof t->bus, "%s", fits ? in->words[1] : "");
    c->state = MEMBER_WAITS;
    return MEMBER_GREETS;
}

/* `echo` is for programs that check that the server is still there. */
static member_result do_echo(member *c, port *p, const command *in, port_frame *out)
{
    (void)p;
    (void)in;
    (void)out;
    say(c, "< echo >");
    return MEMBER_CONTROL;
}

/* `rawmode`, `bcmmode` and `controlmode` differ in their first letters. */
static member_result do_mode(member *c, port *p, const command *in, port_frame *out)
{
    (void)p;
    (void)out;
    enter(c, in->words[0][0] == 'r' ? RAW : in->words[0][0] == 'b' ? BCM : CONTROL);
    say(c, "< ok >");
    return MEMBER_CONTROL;
}

/* A command of socketcand that canwire has no use for: it is refused by its name, and the program
 * stays. */
static member_result do_missing(member *c, port *p, const command *in, port_frame *out)
{
    char text[80];
    (void)out;
    (void)snprintf(text, sizeof text, "%.16s is not supported", in->words[0]);
    return socketcand_complain(c, p, text);
}

/* `send ID LENGTH BYTE...` hands a data frame in. */
static member_result do_send(member *c, port *p, const command *in, port_frame *out)
{
    struct can_frame frame;
    if (!socketcand_read_frame(&frame, in, 1))
        return wrong(c, p, in);
    return hand_in(c, p, &frame, sizeof frame, in->realtime_ns, out);
}

/* `sendrtr ID LENGTH` hands a remote frame in. */
static member_result do_sendrtr(member *c, port *p, const command *in, port_frame *out)
{
    struct can_frame frame = {.can_id = 0};
    uint64_t dlc;
    if (in->count != 3 || !socketcand_read_id(&frame.can_id, in->words[1]) ||
        !socketcand_read_number(&dlc, in->words[2], 10, CAN_MAX_DLEN))
        return wrong(c, p, in);
    frame.can_id |= CAN_RTR_FLAG;
    frame.len = (uint8_t)dlc;
    return hand_in(c, p, &frame, sizeof frame, in->realtime_ns, out);
}

/* `fdsend ID FLAGS DATA` hands a CAN FD frame in, if the node knows such frames. */
static member_result do_fdsend(member *c, port *p, const command *in, port_frame *out)
{
    struct canfd_frame frame = {.can_id = 0};
    uint64_t flags;
    if (!talk_of(c)->fd)
        return socketcand_complain(c, p, "the node knows no CAN FD");
    if (in->count < 4 || !socketcand_read_id(&frame.can_id, in->words[1]) ||
        !socketcand_read_number(&flags, in->words[2], 16, UINT8_MAX) ||
        !socketcand_read_data(&frame.len, frame.data, CANFD_MAX_DLEN, in, 3))
        return wrong(c, p, in);
    frame.flags = (uint8_t)flags;
    return hand_in(c, p, &frame, sizeof frame, in->realtime_ns, out);
}

/* The kernel sends the first frame of a job at once. */
static member_result do_add(member *c, port *p, const command *in, port_frame *out)
{
    struct can_frame frame;
    int64_t interval_ns;
    if (in->count < 5 || !read_interval(&interval_ns, in->words + 1) ||
        !socketcand_read_frame(&frame, in, 3))
        return wrong(c, p, in);
    if (!broadcast_add(&talk_of(c)->broadcast, &frame, interval_ns, clock_ns(CLOCK_MONOTONIC)))
        return socketcand_complain(c, p, "too many jobs");
    set_wake(c);
    return hand_in(c, p, &frame, sizeof frame, in->realtime_ns, out);
}

/* `update` changes the data of a running job. Its identifier says which one. */
static member_result do_update(member *c, port *p, const command *in, port_frame *out)
{
    struct can_frame frame;
    (void)out;
    if (!socketcand_read_frame(&frame, in, 1))
        return wrong(c, p, in);
    if (!broadcast_update(&talk_of(c)->broadcast, &frame))
        return socketcand_complain(c, p, "no job has this identifier");
    return MEMBER_CONTROL;
}

/* `subscribe` gets each frame of an identifier, `filter` those in which bits of a mask have
 * changed. */
static member_result do_subscribe(member *c, port *p, const command *in, port_frame *out)
{
    uint8_t mask[CANFD_MAX_DLEN] = {0}, length;
    const bool filter = in->words[0][0] == 'f';
    int64_t interval_ns;
    canid_t id;
    (void)out;
    if (in->count < 4 || !read_interval(&interval_ns, in->words + 1) ||
        !socketcand_read_id(&id, in->words[3]) || (!filter && in->count != 4) ||
        (filter && !socketcand_read_data(&length, mask, CAN_MAX_DLEN, in, 4)))
        return wrong(c, p, in);
    if (!broadcast_subscribe(&talk_of(c)->broadcast, id, filter ? mask : NULL, interval_ns))
        return socketcand_complain(c, p, "too many subscriptions");
    return MEMBER_CONTROL;
}

/* Removes a job or a subscription. */
static member_result do_remove(member *c, port *p, const command *in, port_frame *out)
{
    const bool job = in->words[0][0] == 'd';
    broadcast *b = &talk_of(c)->broadcast;
    canid_t id;
    (void)out;
    if (in->count != 2 || !socketcand_read_id(&id, in->words[1]))
        return wrong(c, p, in);
    if (!(job ? broadcast_delete(b, id) : broadcast_unsubscribe(b, id)))
        return socketcand_complain(
            c, p, job ? "no job has this identifier" : "no subscription has this identifier");
    set_wake(c);
    return MEMBER_CONTROL;
}

/* `statistics MS` asks for the counters each so many milliseconds; 0 ends that. */
static member_result do_statistics(member *c, port *p, const command *in, port_frame *out)
{
    talk *t = talk_of(c);
    uint64_t milliseconds;
    (void)out;
    if (in->count != 2 || !socketcand_read_number(&milliseconds, in->words[1], 10, UINT32_MAX))
        return wrong(c, p, in);
    t->statistics_ns = (int64_t)milliseconds * NS_PER_MS;
    t->next_statistics_ns = clock_ns(CLOCK_MONOTONIC) + t->statistics_ns;
    set_wake(c);
    return MEMBER_CONTROL;
}

typedef struct command_kind {
    const char *name;
    unsigned modes;
    member_result (*run)(member *c, port *p, const command *in, port_frame *out);
} command_kind;

#define OPENED (BCM | RAW | CONTROL)

static const command_kind commands[] = {
    {"send", BCM | RAW, do_send},
    {"sendrtr", BCM | RAW, do_sendrtr},
    {"fdsend", BCM | RAW, do_fdsend},
    {"open", NO_BUS, do_open},
    {"echo", NO_BUS | OPENED, do_echo},
    {"rawmode", OPENED, do_mode},
    {"bcmmode", OPENED, do_mode},
    {"controlmode", OPENED, do_mode},
    {"isotpmode", OPENED, do_missing},
    {"add", BCM, do_add},
    {"update", BCM, do_update},
    {"delete", BCM, do_remove},
    {"filter", BCM, do_subscribe},
    {"muxfilter", BCM, do_missing},
    {"subscribe", BCM, do_subscribe},
    {"unsubscribe", BCM, do_remove},
    {"statistics", CONTROL, do_statistics},
};

/* `< can0 B … >` and `< can0 C … >` set bit timing and modes of a bus. */
static bool sets_bus(const talk *t, const command *in)
{
    return t->mode == NO_BUS && in->count > 1 &&
           (strcmp(in->words[1], "B") == 0 || strcmp(in->words[1], "C") == 0);
}

/* Runs a command, if the mode of the program has it. One that would change the bus ends the
 * connection, as its program would believe in settings that do not hold. */
static member_result socketcand_run(member *c, port *p, const command *in, port_frame *out)
{
    const talk *t = talk_of(c);
    for (size_t i = 0; in->count > 0 && i < sizeof commands / sizeof commands[0]; i++)
        if ((commands[i].modes & t->mode) && strcmp(in->words[0], commands[i].name) == 0)
            return commands[i].run(c, p, in, out);
    if (sets_bus(t, in)) {
        (void)socketcand_complain(c, p, "bit timing and modes are those of the configuration");
        return MEMBER_GONE;
    }
    return socketcand_complain(c, p, "unknown command");
}

/* ---- From the program ------------------------------------------------------------------------ */

/* Counts what is not a command, once until the next one. */
static void note_garbage(talk *t, port *p)
{
    p->stats.malformed += !t->garbage;
    t->garbage = true;
}

/* Takes bytes, of which the last may be the end of a command. Returns false when that is too
 * long. */
static bool collect(talk *t, port *p, const char *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        if (bytes[i] == '<') {
            if (t->line_bytes > 0)
                note_garbage(t, p);
            t->line_bytes = 0;
        } else if (t->line_bytes == 0) {
            if (!isspace((unsigned char)bytes[i]))
                note_garbage(t, p);
            continue;
        }
        if (t->line_bytes == LINE_BYTES)
            return false;
        t->line[t->line_bytes++] = bytes[i];
    }
    return true;
}

static bool is_complete(const talk *t)
{
    return t->line_bytes > 0 && t->line[t->line_bytes - 1] == '>';
}

/* Splits the command between its brackets. */
static void split(command *out, talk *t)
{
    char *place;
    t->line[t->line_bytes - 1] = '\0';
    for (char *word = strtok_r(t->line + 1, " \t\r\n", &place); word && out->count < WORDS_MAX;
         word = strtok_r(NULL, " \t\r\n", &place))
        out->words[out->count++] = word;
    t->line_bytes = 0;
    t->garbage = false;
}

/* Reads a command, or a part of one. */
static member_result read_command(member *c, port *p, port_frame *out)
{
    talk *t = talk_of(c);
    char bytes[LINE_BYTES];
    command in = {.count = 0};
    bool cut;
    ssize_t size = member_receive(c, bytes, sizeof bytes, MSG_PEEK, &in.realtime_ns, &cut);
    const char *end = size > 0 ? memchr(bytes, '>', (size_t)size) : NULL;
    if (size > 0)
        size = member_receive(c, bytes, end ? (size_t)(end - bytes) + 1 : (size_t)size, 0,
                              &in.realtime_ns, &cut);
    if (size < 0)
        return errno == EAGAIN || errno == EINTR ? MEMBER_NOTHING : MEMBER_GONE;
    if (size == 0)
        return MEMBER_GONE;
    if (!collect(t, p, bytes, (size_t)size)) {
        (void)socketcand_complain(c, p, "the command is too long");
        return MEMBER_GONE;
    }
    if (!is_complete(t))
        return MEMBER_CONTROL;
    split(&in, t);
    return socketcand_run(c, p, &in, out);
}

/* Sends what is due by itself. */
static void send_due(member *c, const port *p, int64_t now_ns)
{
    talk *t = talk_of(c);
    struct can_frame frame;
    int64_t realtime_ns;
    if (t->held_ns != 0 && t->held_ns <= now_ns)
        release_held(c);
    while (broadcast_held(&t->broadcast, &frame, &realtime_ns, now_ns)) {
        struct canfd_frame copy = {.can_id = 0};
        memcpy(&copy, &frame, sizeof frame);
        c->written += put_frame(c, &copy, sizeof frame, realtime_ns);
    }
    if (t->statistics_ns == 0 || t->next_statistics_ns > now_ns)
        return;
    const shared_traffic *s = &((const port_shared *)p)->traffic;
    say(c, "< stat %" PRIu64 " %" PRIu64 " %" PRIu64 " %" PRIu64 " >", s->bytes_out, s->frames_out,
        s->bytes_in, s->frames_in);
    t->next_statistics_ns = now_ns + t->statistics_ns;
}

/* Does what is due. Returns MEMBER_FRAME with a frame of a job. */
static member_result see_to_time(member *c, port *p, port_frame *out)
{
    const int64_t now_ns = clock_ns(CLOCK_MONOTONIC);
    struct can_frame frame;
    int64_t late_ns;
    if (now_ns < c->wake_ns)
        return MEMBER_NOTHING;
    send_due(c, p, now_ns);
    const bool due = broadcast_due(&talk_of(c)->broadcast, &frame, now_ns, &late_ns);
    set_wake(c);
    return due ? hand_in(c, p, &frame, sizeof frame, clock_ns(CLOCK_REALTIME) - late_ns, out)
               : MEMBER_NOTHING;
}

/* Jobs and commands take turns: many jobs must not keep the command from being read that ends
 * them. */
static member_result read_talk(member *c, port *p, port_frame *out)
{
    talk *t = talk_of(c);
    (void)socketcand_flush(c);
    t->job_read = !t->job_read && c->wake_ns != 0 && see_to_time(c, p, out) == MEMBER_FRAME;
    return t->job_read ? MEMBER_FRAME : read_command(c, p, out);
}

/* ---- Coming and going ------------------------------------------------------------------------ */

/* Calls a program by its address. */
static void name_program(member *c)
{
    struct sockaddr_storage peer;
    socklen_t size = sizeof peer;
    char text[INET6_ADDRSTRLEN] = "";
    const struct sockaddr_in *four = (const struct sockaddr_in *)&peer;
    const struct sockaddr_in6 *six = (const struct sockaddr_in6 *)&peer;
    if (getpeername(c->fd, (struct sockaddr *)&peer, &size) != 0)
        return;
    if (peer.ss_family == AF_INET && inet_ntop(AF_INET, &four->sin_addr, text, sizeof text))
        (void)snprintf(c->name, sizeof c->name, "%s:%u", text, ntohs(four->sin_port));
    else if (peer.ss_family == AF_INET6 && inet_ntop(AF_INET6, &six->sin6_addr, text, sizeof text))
        (void)snprintf(c->name, sizeof c->name, "[%s]:%u", text, ntohs(six->sin6_port));
}

/* Begins to speak with a program, which hears "hi" before it says anything. */
static bool open_talk(member *c)
{
    c->more = calloc(1, sizeof(talk));
    if (!c->more)
        return false;
    talk_of(c)->mode = NO_BUS;
    name_program(c);
    say(c, "< hi >");
    return true;
}

/* Drops what nobody will read. It would make the kernel reset the connection, and the last answer
 * would be lost. */
static void close_talk(member *c)
{
    char bytes[LINE_BYTES];
    for (unsigned i = 0; i < DRAINS_MAX; i++)
        if (recv(c->fd, bytes, sizeof bytes, MSG_DONTWAIT) <= 0)
            break;
    broadcast_free(&talk_of(c)->broadcast);
    free(talk_of(c)->held);
    free(c->more);
    c->more = NULL;
}

const member_kind member_socketcand = {.open = open_talk,
                                       .close = close_talk,
                                       .read = read_talk,
                                       .lose = socketcand_lose,
                                       .welcome = welcome,
                                       .tell = socketcand_tell,
                                       .takes = takes,
                                       .send = socketcand_send_frame};
