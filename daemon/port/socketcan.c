/* SPDX-License-Identifier: MIT
 *
 * socketcan.c - a port on a raw CAN socket.
 *
 * The socket reads frames of the ECU's programs. The kernel does not loop back the socket's own
 * frames; port.c skips any that are flagged as confirmed.
 */
#include "port/kinds.h"

#include "base/log.h"
#include "port/claim.h"
#include "port/gathered.h"

#include <errno.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/sock_diag.h>
#include <net/if.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

typedef struct socketcan_port {
    port port;
    claim claim;
    gathered gathered; /* frames for the ECU's programs */
} socketcan_port;

/* ---- Opening --------------------------------------------------------------------------------- */

static bool set_option(int fd, int level, int option, int value)
{
    return setsockopt(fd, level, option, &value, sizeof value) == 0;
}

/* Asks for a buffer. Without CAP_NET_ADMIN the kernel grants net.core.rmem_max at most. It doubles
 * the number for its own data, and returns the double. */
static void ask_for_room(port *p)
{
    int granted = 0;
    socklen_t size = sizeof granted;
    if (!set_option(p->fd, SOL_SOCKET, SO_RCVBUFFORCE, PORT_BUFFER_BYTES))
        (void)set_option(p->fd, SOL_SOCKET, SO_RCVBUF, PORT_BUFFER_BYTES);
    if (getsockopt(p->fd, SOL_SOCKET, SO_RCVBUF, &granted, &size) == 0)
        p->buffer_bytes = (unsigned)granted / 2;
}

/* Asks for times of arrival, the count of lost frames, CAN FD frames and all error frames. */
static bool set_options(port *p)
{
    const int fd = p->fd;
    ask_for_room(p);
    return set_option(fd, SOL_SOCKET, SO_TIMESTAMPNS, 1) &&
           set_option(fd, SOL_SOCKET, SO_RXQ_OVFL, 1) &&
           set_option(fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, 1) &&
           set_option(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, (int)CAN_ERR_MASK);
}

/* Binds the socket to an interface, and keeps the index: the name may move to another one. */
static bool bind_to(port *p, const char *interface)
{
    struct sockaddr_can address = {.can_family = AF_CAN};
    struct ifreq request = {.ifr_ifindex = 0};
    (void)snprintf(request.ifr_name, sizeof request.ifr_name, "%s", interface);
    if (ioctl(p->fd, SIOCGIFINDEX, &request) != 0)
        return false;
    p->index = (unsigned)request.ifr_ifindex;
    address.can_ifindex = request.ifr_ifindex;
    return bind(p->fd, (const struct sockaddr *)&address, sizeof address) == 0;
}

/* Explains a failure. found: the interface exists. */
static void explain(char error[PORT_ERROR_TEXT_MAX], const char *interface, bool found, int number)
{
    const char *remedy = "";
    if (number == ENODEV && found)
        remedy = " for CAN: it is another kind of interface";
    else if (number == ENODEV)
        remedy = " (canwire vcan up FILE makes it)";
    else if (number == EAFNOSUPPORT)
        remedy = " (this kernel has no CAN: modprobe can-raw vcan)";
    else if (number == EMFILE)
        remedy = " (raise the limit: ulimit -n, LimitNOFILE=)";
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "%s: %s%s", interface, strerror(number), remedy);
}

/* ---- Frames ---------------------------------------------------------------------------------- */

/* Reads up to max frames; *more: some may be left. */
static unsigned read_socket(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more)
{
    int received = port_receive(p, p->fd, max);
    /* an error of the interface is reported only once; frames may wait behind it */
    bool error = received < 0 && errno != EAGAIN && errno != EINTR;
    *more = received == (int)max || error;
    return port_take(p, frames, received);
}

static port_sent send_at_once(port *p, const void *frame, size_t size)
{
    bool good = send(p->fd, frame, size, MSG_DONTWAIT) == (ssize_t)size;
    return good ? PORT_SENT : PORT_SEND_FAILED;
}

static port_sent send_to_socket(port *p, const void *frame, size_t size)
{
    if (!p->gathers)
        return send_at_once(p, frame, size);
    return gathered_take(&((socketcan_port *)p)->gathered, p, frame, size);
}

static void flush_socket(port *p)
{
    (void)gathered_send(&((socketcan_port *)p)->gathered, p, p->fd, send_at_once);
}

/* Counts frames that the kernel has dropped since then, also when no later frame tells of it. */
static void count_drops(port *p)
{
    uint32_t memory[SK_MEMINFO_VARS] = {0};
    socklen_t size = sizeof memory;
    if (getsockopt(p->fd, SOL_SOCKET, SO_MEMINFO, memory, &size) == 0)
        port_count_drops(p, memory[SK_MEMINFO_DROPS]);
}

/* Asks by the index: the name may belong to another interface by now. 0: it is not known. */
static unsigned read_mtu(const port *p)
{
    struct ifreq request = {.ifr_mtu = 0};
    if (!if_indextoname(p->index, request.ifr_name))
        return 0;
    return ioctl(p->fd, SIOCGIFMTU, &request) == 0 ? (unsigned)request.ifr_mtu : 0;
}

/* Frames that are gathered leave first. The claim lasts until the socket is closed. */
static void close_socket(port *p)
{
    flush_socket(p);
    if (p->fd >= 0)
        (void)close(p->fd);
    claim_release(&((socketcan_port *)p)->claim);
    free(p);
}

static const port_kind socketcan = {.close = close_socket,
                                    .read = read_socket,
                                    .send = send_to_socket,
                                    .flush = flush_socket,
                                    .count = count_drops,
                                    .mtu = read_mtu,
                                    .control_bytes = PORT_CONTROL_BYTES};

/* Returns true for the main name of an interface. The kernel also finds alternative names, but
 * reports changes only by the main name. A node with another name would leave the bus at once. */
static bool is_own_name(const port *p, const char *interface, char error[PORT_ERROR_TEXT_MAX])
{
    char name[IF_NAMESIZE];
    if (!if_indextoname(p->index, name) || strcmp(name, interface) == 0)
        return true;
    (void)snprintf(error, PORT_ERROR_TEXT_MAX, "%.*s: only another name (altname) of %s: use that",
                   IF_NAMESIZE - 1, interface, name);
    return false;
}

/* Claims an interface in this network namespace for a bus, since two canwired on one would carry
 * each other's frames for ever. Returns false with a text that says who has it. */
static bool claim_interface(socketcan_port *s, const char *interface, const char *bus,
                            char error[PORT_ERROR_TEXT_MAX])
{
    char key[CLAIM_KEY_BYTES];
    claim_owner owner;
    claim_print_port(key, s->port.index);
    const int number = claim_take(&s->claim, key, bus);
    if (number == 0)
        return true;
    if (number != EADDRINUSE)
        (void)snprintf(error, PORT_ERROR_TEXT_MAX, "%s: cannot be claimed: %s", interface,
                       strerror(number));
    else if (claim_find(&owner, key))
        (void)snprintf(error, PORT_ERROR_TEXT_MAX, "%s: in use by bus %s of canwired, pid %ld",
                       interface, owner.name, owner.pid);
    else
        (void)snprintf(error, PORT_ERROR_TEXT_MAX, "%s: in use by another canwired", interface);
    return false;
}

port *port_socketcan_open(const char *interface, const char *bus, char error[PORT_ERROR_TEXT_MAX])
{
    port *p = port_new(&socketcan, sizeof(socketcan_port));
    if (!p) {
        explain(error, interface, false, ENOMEM);
        return NULL;
    }
    socketcan_port *s = (socketcan_port *)p;
    s->claim = (claim)CLAIM_NONE;
    p->fd = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (p->fd < 0 || !set_options(p) || !bind_to(p, interface)) {
        explain(error, interface, p->index != 0, errno);
        close_socket(p);
        return NULL;
    }
    if (!is_own_name(p, interface, error) || !claim_interface(s, interface, bus, error)) {
        close_socket(p);
        return NULL;
    }
    return p;
}
