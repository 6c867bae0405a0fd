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

/* The end of a tunnel. Times in ns. */
typedef struct port_tunnel_info {
    const char *state; /* "up", "waiting" or "connecting" */
    uint64_t packets_read;
    uint64_t packets_written;
    uint64_t missing;    /* by gaps of the sequence numbers; also those that are late */
    uint64_t late;       /* that have come after others, and count as missing */
    uint64_t duplicate;  /* that have come twice; dropped */
    uint64_t restarts;   /* of the peer's sequence numbers */
    uint64_t malformed;  /* dropped */
    uint64_t strangers;  /* of others than the peer; dropped */
    uint64_t held_last_ns; /* for which the first frame of a packet has waited for others */
    uint64_t held_max_ns;
    uint64_t waited_last_ns; /* for which a packet has waited in the kernel until it was read */
    uint64_t waited_max_ns;
} port_tunnel_info;

/* Counters, all of them uint64_t. */
typedef struct port_stats {
    uint64_t read;            /* frames that were read for the bus */
    uint64_t read_failed;     /* reads that the kernel refused for reasons of its own */
    uint64_t written;         /* frames given to the ECU's interface; error frames not counted */
    uint64_t write_failed;    /* frames that the kernel did not take */
    uint64_t unheard;         /* frames for an ECU that was not connected, or has not said that it
                                 takes CAN FD frames; unix:PATH, fd:NUMBER */
    uint64_t kernel_dropped;  /* frames lost in the kernel before they could be read */
    uint64_t errors_written;  /* error frames given to the ECU's interface */
    uint64_t errors_failed;   /* error frames that the kernel did not take */
    uint64_t errors_left_out; /* error frames not written because there were too many */
    uint64_t errors_unheard; /* error frames for an ECU that was not connected */
    uint64_t errors_ignored; /* error frames that an ECU wrote itself; they never enter the bus.
                                Other programs of the port get them */
    uint64_t malformed;      /* messages of an ECU that are no frames */
    uint64_t connected;      /* number of connections of an ECU */
    uint64_t refused;        /* connections refused since an ECU was connected already */
    uint64_t loopless;       /* frames that programs sent without loopback: on vcan they are lost */
    uint64_t pushed_back;    /* number of times that reading paused: the node's queue was full */
    uint64_t echoed;         /* frames of clients given to other programs of the port, or back */
    uint64_t clients_lost;   /* messages that single clients had no room for */
    uint64_t unconfirmed;    /* frames of clients of which it was not known when they were sent */
    uint64_t missing;        /* packets of a tunnel that have not come */
    uint64_t strangers;      /* packets and connections of others than its peer */
    uint64_t gave_way;       /* connections that had said nothing, ended for new ones */
    uint64_t rounded;        /* CAN FD frames read with a length that no DLC has: zeros fill them */
} port_stats;

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

/* Returns true while clients are there that want to know what becomes of frames: the caller then
 * makes the three calls below. */
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

/* Says that the node has no frame any more. Frames of which it was not told what has become of them
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
