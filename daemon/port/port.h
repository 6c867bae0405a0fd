/* SPDX-License-Identifier: MIT
 *
 * port.h - the daemon's end of an ECU's interface: frames in with their arrival time, frames out.
 */
#ifndef CANWIRE_PORT_PORT_H
#define CANWIRE_PORT_PORT_H

#include "canwire.h"
#include "port/control.h"
#include "trace/errframe.h"

#define PORT_BATCH 64          /* frames of one read */
#define PORT_ERROR_TEXT_MAX 300 /* a path and the reason, as in pathsocket.h */
#define PORT_BUFFER_BYTES (8 << 20) /* requested for frames that wait to be read */

typedef struct port port;

/* A frame that an ECU wrote. It may be invalid (cw_frame_valid()): the bus then counts it as
 * such. */
typedef struct port_frame {
    cw_frame frame;
    bool is_error;       /* an error frame: never for the bus, but for the other programs of the
                            port. Its class is the identifier */
    int64_t realtime_ns; /* CLOCK_REALTIME of arrival; 0: unknown */
    uint32_t client;     /* that has sent it, at a shared port; 0: the plain ECU */
    uint32_t number;     /* that the client has given it */
    uint32_t options;    /* of the client then, MESSAGE_* */
} port_frame;

/* The moment at which a client sees the frames of the others. */
typedef enum port_echo {
    PORT_ECHO_AT_ONCE = 0, /* as on vcan: when they are handed in */
    PORT_ECHO_SENT         /* as at a real interface: when the bus has sent them */
} port_echo;

#define PORT_CLIENTS_MAX 63u

/* The rules for programs that share a port. */
typedef struct port_sharing {
    const char *node; /* its name; copied */
    bool fd;          /* the node knows CAN FD */
    unsigned max;     /* of clients; 0: plain ECUs only */
    port_echo echo;
    bool beacon;      /* tcp: tells the local network of itself */
} port_sharing;

/* The order of a program that is the controller of the node. */
typedef struct port_command {
    message_order order;
    char settings[MESSAGE_SETTINGS_BYTES]; /* "": none */
} port_command;

/* The reasons for which a process may have waited. */
#define PORT_TOLD_MESSAGE 0x01u /* a message for it, or its end */
#define PORT_TOLD_ROOM 0x02u    /* a message of it was read */

typedef struct port_told {
    int pid; /* 0: of some process */
    unsigned what;
} port_told;

#define PORT_TOLD_MAX 32u

/* One of the programs at a port. */
typedef struct port_client_info {
    const char *name; /* of a client, "" when it has not said one; NULL: the plain ECU */
    uint64_t read;
    uint64_t written;
    uint64_t lost;
} port_client_info;

/* The end of a tunnel: its counters, in rows as in canwire_counters.h; all of them are uint64_t. */
#define PORT_TUNNEL_COUNTERS(X)                                                                    \
    X(ONE, uint64_t, packets_read, TIMES, USUAL, LCM, NOWHERE, "a packet of the peer was read")    \
    X(ONE, uint64_t, packets_written, TIMES, USUAL, LCM, NOWHERE, "a packet was sent to it")       \
    X(ONE, uint64_t, missing, TIMES, USUAL, LCM, NOWHERE,                                          \
      "a packet has not come, by gaps of the sequence numbers; also those that are late")          \
    X(ONE, uint64_t, late, TIMES, USUAL, LCM, NOWHERE,                                             \
      "a packet has come after others, and counts as missing")                                     \
    X(ONE, uint64_t, duplicate, TIMES, USUAL, LCM, NOWHERE, "a packet has come twice; dropped")    \
    X(ONE, uint64_t, restarts, TIMES, USUAL, LCM, NOWHERE,                                         \
      "the sequence numbers of the peer have begun anew")                                          \
    X(ONE, uint64_t, malformed, TIMES, USUAL, LCM, NOWHERE, "a packet was wrong; dropped")         \
    X(ONE, uint64_t, strangers, TIMES, USUAL, LCM, NOWHERE,                                        \
      "a packet came from another than the peer; dropped")                                         \
    X(NOW, uint64_t, held_last_ns, NS, USUAL, LCM, NOWHERE,                                        \
      "for which the first frame of the last packet was held here for others")                     \
    X(NOW, uint64_t, held_max_ns, NS, USUAL, LCM, NOWHERE, "the longest of these")                 \
    X(NOW, uint64_t, waited_last_ns, NS, USUAL, LCM, NOWHERE,                                      \
      "for which the last packet waited in the kernel until it was read")                          \
    X(NOW, uint64_t, waited_max_ns, NS, USUAL, LCM, NOWHERE, "the longest of these")

typedef struct port_tunnel_info {
    const char *state; /* "up", "waiting" or "connecting" */
    PORT_TUNNEL_COUNTERS(CW_MEMBER)
} port_tunnel_info;

extern const cw_stat port_tunnel_counters[];

/* The counters between a node and its ECU, in rows as in canwire_counters.h; all of them are
 * uint64_t. */
#define PORT_COUNTERS(X)                                                                           \
    X(ONE, uint64_t, read, FRAMES, USUAL, NONE, NOWHERE,                                           \
      "written by the ECU and taken by the node")                                                  \
    X(ONE, uint64_t, read_failed, TIMES, USUAL, NONE, NOWHERE,                                     \
      "the kernel refused to read the port, but for a link that is down or an ECU that is gone")   \
    X(ONE, uint64_t, written, FRAMES, USUAL, NONE, NOWHERE, "given to the ECU")                    \
    X(ONE, uint64_t, write_failed, FRAMES, USUAL, NONE, NOWHERE, "not taken by the kernel")        \
    X(ONE, uint64_t, unheard, FRAMES, USUAL, NONE, NOWHERE,                                        \
      "received while no ECU was connected, or none that wants them (CAN FD frames, filters; "     \
      "canwire-ports(7))")                                                                         \
    X(ONE, uint64_t, kernel_dropped, FRAMES, USUAL, NONE, NOWHERE,                                 \
      "of the ECU, lost by the kernel before they could be read")                                  \
    X(ONE, uint64_t, errors_written, FRAMES, USUAL, NONE, NOWHERE, "error frames for it")          \
    X(ONE, uint64_t, errors_failed, FRAMES, USUAL, NONE, NOWHERE,                                  \
      "error frames not taken by the kernel")                                                      \
    X(ONE, uint64_t, errors_left_out, FRAMES, USUAL, NONE, NOWHERE,                                \
      "error frames not given to the ECU because there were too many")                             \
    X(ONE, uint64_t, errors_unheard, FRAMES, USUAL, NONE, NOWHERE,                                 \
      "error frames while no ECU was connected")                                                   \
    X(ONE, uint64_t, errors_ignored, FRAMES, USUAL, NONE, NOWHERE,                                 \
      "error frames written by the ECU itself; they never enter the bus, but other programs of "   \
      "its node get them")                                                                         \
    X(ONE, uint64_t, malformed, TIMES, USUAL, NONE, NOWHERE,                                       \
      "a message of the ECU was no frame, or one of a client was wrong")                           \
    X(ONE, uint64_t, connected, TIMES, USUAL, NONE, NOWHERE, "a program connected")                \
    X(ONE, uint64_t, refused, TIMES, USUAL, NONE, NOWHERE,                                         \
      "a program was refused since the places were taken")                                         \
    X(ONE, uint64_t, gave_way, TIMES, USUAL, NONE, NOWHERE,                                        \
      "a connection that had said nothing was ended for a new one when all places were taken")     \
    X(ONE, uint64_t, pushed_back, TIMES, USUAL, NONE, NOWHERE,                                     \
      "the port was not read for a while, since the node's queue was full (`when-full: wait`)")    \
    X(ONE, uint64_t, loopless, FRAMES, USUAL, NONE, NOWHERE,                                       \
      "sent by programs of the ECU without loopback (`CAN_RAW_LOOPBACK` 0, `cangen -x`): on a "    \
      "vcan they reach nobody; looked at once a second")                                           \
    X(ONE, uint64_t, rounded, FRAMES, USUAL, NONE, NOWHERE,                                        \
      "CAN FD frames written by the ECU with a length that no DLC has: they go on the bus with "   \
      "zeros behind the data")                                                                     \
    X(ONE, uint64_t, echoed, FRAMES, USUAL, NONE, NOWHERE,                                         \
      "of programs, given to the others at the port, or back to their client")                     \
    X(ONE, uint64_t, clients_lost, TIMES, USUAL, NONE, NOWHERE,                                    \
      "a client had no room for a message")                                                        \
    X(ONE, uint64_t, unconfirmed, FRAMES, USUAL, NONE, NOWHERE,                                    \
      "of clients, too many to be followed until the bus has sent them")                           \
    X(ONE, uint64_t, missing, TIMES, CODE, NONE, NOWHERE, "a packet of a tunnel has not come")     \
    X(ONE, uint64_t, strangers, TIMES, CODE, NONE, NOWHERE,                                        \
      "a packet or a connection came from others than the peer of a tunnel")

typedef struct port_stats {
    PORT_COUNTERS(CW_MEMBER)
} port_stats;

extern const cw_stat port_counters[];

void port_close(port *p);

/* Returns the index of the interface that the port was opened on. That may have another name or be
 * gone by now. Returns 0 without an interface. */
unsigned port_index(const port *p);

/* Returns the part of PORT_BUFFER_BYTES that the kernel has granted, in the unit of
 * net.core.rmem_max. A full buffer drops frames. All of it counts as granted for a port whose ECU
 * waits instead. */
unsigned port_buffer_bytes(const port *p);

/* Returns the MTU of the port's interface: CAN FD frames need CANFD_MTU. Returns 0 without an
 * interface, or when it has gone. */
unsigned port_mtu(const port *p);

/* Returns a descriptor that is readable when frames wait. */
int port_fd(const port *p);

/* Reads up to max waiting frames, from 1 to PORT_BATCH. Returns the number of frames; *more: read
 * again. */
unsigned port_read(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more);

/* Returns true when reading has begun to fail, *error an errno, or works again, *error 0, since the
 * last call. An interface that is down or gone, and an ECU that has gone, do not count. */
bool port_reading_changed(port *p, int *error);

/* Takes the numbers of frames that were sent without loopback on its interface since that was made,
 * at least and at most. Counts those since the port was opened; the first call begins with the
 * upper limit, so that no older frame counts. counting: false only sets the beginning. */
void port_count_loopless(port *p, int64_t least, int64_t most, bool counting);

/* Counts a pause of reading, since the node's queue is full. */
void port_pushed_back(port *p);

/* Sets how programs share the port; a port that no programs can share ignores it. */
void port_share(port *p, const port_sharing *sharing);

/* Returns true while clients are there that want to know what happens to their frames: the caller
 * then makes the three calls below. */
bool port_is_shared(const port *p);

/* Sets the time of what is sent next. */
void port_set_time(port *p, uint64_t tick, int64_t realtime_ns);

/* Says that a frame that was read has been handed in, or that its turn has come for an error frame,
 * at the time set. */
void port_handed_in(port *p, const port_frame *frame);

/* Says that the bus has sent (CW_EVENT_TX) or dropped a frame of the node. */
void port_ended(port *p, const cw_event *event);

/* Returns true when the only client of a port has gone, see door.h. */
bool port_is_over(const port *p);

/* Takes what processes at the port were told since the last call. Returns their number. */
unsigned port_take_told(port *p, port_told told[PORT_TOLD_MAX]);

/* Describes the n-th program at a port. Returns false when there are fewer. */
bool port_client(const port *p, unsigned n, port_client_info *out);

/* Describes a port that is the end of a tunnel. Returns false for other kinds. */
bool port_tunnel(const port *p, port_tunnel_info *out);

/* Returns true for a port whose node has its controller in a program: the node is on the bus only
 * while that program says so. */
bool port_has_controller(const port *p);

/* Returns what the controller has ordered, NULL: nothing. The port is not read meanwhile. */
const port_command *port_next_command(const port *p);

/* Says that this is done; problem: why not, or NULL. */
void port_obeyed(port *p, const char *problem);

/* Returns the settings that the controller has set last; "": none. */
const char *port_settings(const port *p);

/* Returns what the controller was told last; all zero: nothing yet. */
message_state port_told_state(const port *p);

/* Tells the controller the state of its node, if that is not what it was told last. */
void port_tell_state(port *p, const message_state *state);

/* Says that the node has no frame left. Frames whose fate it was not told
 * count as sent: rules have changed them. */
void port_settle(port *p);

/* From now on frames may be gathered, so that one call of the kernel takes several. They go when
 * there are many, or with port_flush(), in their order. */
void port_gather(port *p);

/* Writes what was gathered, and counts it. From now on each frame goes at once. */
void port_flush(port *p);

/* Writes a frame, a CAN FD frame with CANFD_FDF. Returns false, and counts the failure, when the
 * kernel does not take it. A frame that was gathered counts later. */
bool port_write(port *p, const cw_frame *frame);

/* Writes an error frame, as a driver gives it to the ECU's programs. Storms of minor ones are
 * limited (errframe_limit_pass()); left-out frames are counted. tick: bus time of the event. */
bool port_write_error(port *p, const errframe *frame, uint64_t tick);

/* Writes an error frame (CRTL RX_OVERFLOW) when the kernel has lost more frames of the ECU, ten
 * times a second at most. tick: bus time. */
void port_report_overflow(port *p, uint64_t tick);

void port_get_stats(port *p, port_stats *stats);

#endif
