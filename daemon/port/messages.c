/* SPDX-License-Identifier: MIT
 *
 * messages.c - a program at a port that speaks the protocol of messages.h.
 */
#include "port/messages.h"

#include "port/member.h"

#include <errno.h>
#include <linux/can/error.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define HELLO_BYTES (sizeof(message_head) + sizeof(message_hello))
#define NAME_CHARS                                                                                 \
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_."
#define EFF_AND_RTR (CAN_EFF_FLAG | CAN_RTR_FLAG)

/* ---- To the client --------------------------------------------------------------------------- */

/* Sends a message. An end that has gone loses nothing. */
static bool send_message(member *c, message_head *head, const void *body, size_t size)
{
    unsigned char bytes[sizeof *head + sizeof(message_error)]; /* the longest one */
    head->size = (uint16_t)(sizeof *head + size);
    head->lost = c->lost;
    memcpy(bytes, head, sizeof *head);
    memcpy(bytes + sizeof *head, body, size);
    if (send(c->fd, bytes, head->size, MSG_DONTWAIT | MSG_NOSIGNAL) >= 0)
        return true;
    c->lost += errno != EPIPE && errno != ECONNRESET && errno != ENOTCONN;
    return false;
}

static bool messages_send_frame(member *c, const message_head *head, const void *frame, size_t size)
{
    message_head own = *head;
    return send_message(c, &own, frame, size);
}

/* Answers a hello, and so says which frames the node takes. */
static void welcome(member *c, const char *node, bool fd)
{
    message_head head = {.type = MESSAGE_HELLO};
    message_hello hello = {
        .magic = MESSAGE_MAGIC,
        .version = MESSAGE_VERSION,
        .options = c->options,
        .error_mask = c->error_mask,
        .mtu = fd ? CANFD_MTU : CAN_MTU,
    };
    (void)snprintf(hello.name, sizeof hello.name, "%s", node);
    (void)send_message(c, &head, &hello, sizeof hello);
}

/* Answers a message with an error number, and a text for people. */
static void messages_tell(member *c, const message_head *head, int code, const char *text)
{
    message_head own = *head;
    message_error error = {.code = (uint32_t)code};
    (void)snprintf(error.text, sizeof error.text, "%s", text);
    (void)send_message(c, &own, &error, sizeof error.code + strlen(error.text) + 1);
}

static void flushed(member *c, const message_head *head)
{
    message_head own = *head;
    own.number = c->flush_number;
    (void)send_message(c, &own, "", 0);
}

static void tell_state(member *c, const message_head *head, const message_state *state)
{
    message_head own = *head;
    (void)send_message(c, &own, state, sizeof *state);
}

/* ---- Filters --------------------------------------------------------------------------------- */

/* Returns true when a filter is for a frame, as the kernel's can_rcv_list_find() has it. A filter
 * with CAN_ERR_FLAG in its mask is for error frames, and for nothing else. */
static bool passes(const struct can_filter *filter, canid_t can_id)
{
    const bool inverted = filter->can_id & CAN_INV_FILTER;
    canid_t mask = filter->can_mask;
    if (mask & CAN_ERR_FLAG)
        return (can_id & CAN_ERR_FLAG) && (can_id & mask & CAN_ERR_MASK);
    if (can_id & CAN_ERR_FLAG)
        return false;
    if ((mask & CAN_EFF_FLAG) && !(filter->can_id & CAN_EFF_FLAG))
        mask &= CAN_SFF_MASK | EFF_AND_RTR;
    const canid_t wanted = filter->can_id & mask & (CAN_EFF_MASK | EFF_AND_RTR);
    return ((can_id & mask) == wanted) != inverted;
}

/* Returns true when a frame passes the client's filters. As with CAN_RAW, one of them is enough, or
 * all must agree (MESSAGE_JOIN). A client without filters gets all frames but error frames. */
static bool pass_filters(const member *c, canid_t can_id)
{
    unsigned passed = 0;
    if (!c->filters)
        return !(can_id & CAN_ERR_FLAG);
    for (unsigned i = 0; i < c->filter_count; i++)
        passed += passes(&c->filters[i], can_id);
    return c->options & MESSAGE_JOIN ? passed == c->filter_count && passed > 0 : passed > 0;
}

/* Returns true when a client wants a frame. Error frames pass by their mask or by a filter. */
static bool takes(const member *c, const void *frame, size_t size)
{
    canid_t can_id;
    memcpy(&can_id, frame, sizeof can_id);
    if (size == CANFD_MTU && !(c->options & MESSAGE_FD))
        return false;
    return ((can_id & CAN_ERR_FLAG) && (can_id & c->error_mask & CAN_ERR_MASK)) ||
           pass_filters(c, can_id);
}

/* ---- From the client ------------------------------------------------------------------------- */

/* Counts a message that cannot be understood, and says so. */
static member_result messages_complain(member *c, port *p, unsigned type, int code,
                                       const char *text)
{
    p->stats.malformed++;
    member_refuse(c, type, code, text);
    return c->state == MEMBER_THERE ? MEMBER_CONTROL : MEMBER_GONE;
}

/* Returns true for a name that may stand in events and logs; "" stands for none. */
static bool is_name(const char name[MESSAGE_NAME_BYTES])
{
    const size_t length = strnlen(name, MESSAGE_NAME_BYTES);
    return length <= MEMBER_NAME_MAX && strspn(name, NAME_CHARS) == length;
}

static bool are_options(uint32_t options)
{
    return !(options & ~MESSAGE_OPTIONS_KNOWN);
}

/* Checks the first message of a client, which then waits for a place. Another version is refused: a
 * client never guesses. */
static member_result take_hello(member *c, port *p, const message *m, size_t size)
{
    char text[MESSAGE_TEXT_BYTES];
    const message_hello *hello = &m->hello;
    if (m->head.type != MESSAGE_HELLO || size != HELLO_BYTES ||
        memcmp(hello->magic, MESSAGE_MAGIC, sizeof hello->magic) != 0)
        return messages_complain(c, p, m->head.type, EPROTO, "the first message is no hello");
    (void)snprintf(text, sizeof text, "version %u is not known: version %u is", hello->version,
                   MESSAGE_VERSION);
    if (hello->version != MESSAGE_VERSION)
        return messages_complain(c, p, MESSAGE_HELLO, EPROTONOSUPPORT, text);
    if (!are_options(hello->options))
        return messages_complain(c, p, MESSAGE_HELLO, EOPNOTSUPP, "options that are not known");
    if (!is_name(hello->name))
        return messages_complain(c, p, MESSAGE_HELLO, EINVAL,
                                 "a name has at most 32 letters, digits, '-', '_' and '.'");
    c->options = hello->options;
    c->error_mask = hello->error_mask;
    memcpy(c->name, hello->name, MEMBER_NAME_MAX); /* a 0 follows */
    c->state = MEMBER_WAITS;
    return MEMBER_GREETS;
}

/* Takes new options. The hello has said who is the controller, and that stays. */
static member_result take_options(member *c, port *p, const message *m, size_t size)
{
    if (size != sizeof m->head + sizeof m->options || !are_options(m->options.options))
        return messages_complain(c, p, MESSAGE_OPTIONS, EINVAL, "options that are not known");
    if ((m->options.options ^ c->options) & MESSAGE_CONTROLLER)
        return messages_complain(c, p, MESSAGE_OPTIONS, EINVAL,
                                 "the hello says who is the controller");
    c->options = m->options.options;
    c->error_mask = m->options.error_mask;
    return MEMBER_CONTROL;
}

/* No filter at all lets nothing pass, as in the kernel. */
static member_result take_filters(member *c, port *p, const message *m, size_t size)
{
    const size_t bytes = size - sizeof m->head;
    if (bytes % sizeof *c->filters != 0)
        return messages_complain(c, p, MESSAGE_FILTERS, EINVAL, "a filter has 8 bytes");
    struct can_filter *filters = malloc(bytes + 1);
    if (!filters)
        return messages_complain(c, p, MESSAGE_FILTERS, ENOMEM, "no memory for filters");
    memcpy(filters, m->filters, bytes);
    free(c->filters);
    c->filters = filters;
    c->filter_count = (unsigned)(bytes / sizeof *filters);
    return MEMBER_CONTROL;
}

/* Takes a frame for the bus. A message that is not a frame is refused, and the client stays. */
static member_result messages_take_frame(member *c, port *p, const message *m, size_t size,
                                         port_frame *out)
{
    const size_t bytes = size - sizeof m->head;
    if (bytes == CANFD_MTU && !(c->options & MESSAGE_FD))
        return messages_complain(c, p, MESSAGE_FRAME, EINVAL, "a CAN FD frame without the option");
    if (!port_take_frame(p, out, &m->fd, bytes)) {
        member_refuse(c, MESSAGE_FRAME, EINVAL, "no frame for the bus");
        return MEMBER_CONTROL;
    }
    out->number = m->head.number;
    out->client = c->id;
    out->options = c->options;
    c->read += !out->is_error;
    c->flushable += !out->is_error && (c->options & MESSAGE_FLUSHES);
    return MEMBER_FRAME;
}

/* Notes a question: the port answers when the frames have ended. */
static member_result take_flush(member *c, port *p, const message *m, size_t size)
{
    if (!(c->options & MESSAGE_FLUSHES))
        return messages_complain(c, p, MESSAGE_FLUSH, EOPNOTSUPP, "a flush without the option");
    if (size != sizeof m->head)
        return messages_complain(c, p, MESSAGE_FLUSH, EINVAL, "a flush has no body");
    c->flushing = true;
    c->flush_at = c->flushable;
    c->flush_number = m->head.number;
    return MEMBER_CONTROL;
}

/* Takes what the controller of the node orders. */
static member_result take_control(member *c, port *p, const message *m, size_t size)
{
    const size_t before = sizeof m->head + sizeof m->control.order;
    if (!p->commands || !(c->options & MESSAGE_CONTROLLER))
        return messages_complain(c, p, MESSAGE_CONTROL, EPERM, "only the controller may do this");
    if (size < before || size - before >= sizeof m->control.settings ||
        m->control.order >= MESSAGE_ORDERS)
        return messages_complain(c, p, MESSAGE_CONTROL, EINVAL, "no order that is known");
    port_command *command = &p->commands->next;
    command->order = (message_order)m->control.order;
    memcpy(command->settings, m->control.settings, size - before);
    command->settings[size - before] = '\0';
    p->commands->waits = true;
    return MEMBER_COMMAND;
}

/* Takes a message of a client that is there. */
static member_result messages_take(member *c, port *p, const message *m, size_t size,
                                   port_frame *out)
{
    if (size < sizeof m->head || m->head.size != size)
        return messages_complain(c, p, 0, EPROTO, "its head has another size");
    switch (m->head.type) {
    case MESSAGE_FRAME:
        return messages_take_frame(c, p, m, size, out);
    case MESSAGE_OPTIONS:
        return take_options(c, p, m, size);
    case MESSAGE_FILTERS:
        return take_filters(c, p, m, size);
    case MESSAGE_FLUSH:
        return take_flush(c, p, m, size);
    case MESSAGE_CONTROL:
        return take_control(c, p, m, size);
    default:
        return messages_complain(c, p, m->head.type, EOPNOTSUPP, "a type that is not known");
    }
}

/* Reads a message of a client and does what it says. */
static member_result read_message(member *c, port *p, port_frame *out)
{
    message m;
    bool cut;
    m.head = (message_head){.type = 0};
    const ssize_t size = member_receive(c, &m, sizeof m, 0, &out->realtime_ns, &cut);
    if (size < 0)
        return errno == EAGAIN || errno == EINTR ? MEMBER_NOTHING : MEMBER_GONE;
    if (size == 0)
        return MEMBER_GONE;
    if (cut)
        return messages_complain(c, p, m.head.type, EMSGSIZE, "the message is too long");
    return c->state == MEMBER_NEW ? take_hello(c, p, &m, (size_t)size)
                                  : messages_take(c, p, &m, (size_t)size, out);
}

/* The kernel bounds what waits. The program has gone, so no more comes. Its end is reported once,
 * before the messages. */
static uint64_t messages_lose(member *c)
{
    uint8_t type;
    uint64_t count = 0;
    ssize_t size = recv(c->fd, &type, sizeof type, MSG_DONTWAIT);
    if (size < 0 && errno == ECONNRESET)
        size = recv(c->fd, &type, sizeof type, MSG_DONTWAIT);
    for (; size > 0; size = recv(c->fd, &type, sizeof type, MSG_DONTWAIT))
        count += type == MESSAGE_FRAME;
    return count;
}

const member_kind member_messages = {.read = read_message,
                                     .lose = messages_lose,
                                     .welcome = welcome,
                                     .tell = messages_tell,
                                     .flushed = flushed,
                                     .tell_state = tell_state,
                                     .takes = takes,
                                     .send = messages_send_frame};
