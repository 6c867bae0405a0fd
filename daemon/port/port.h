/* SPDX-License-Identifier: MIT
 *
 * port.h - the daemon's end of an ECU's interface: frames in with their arrival time, frames out.
 */
#ifndef CANWIRE_PORT_PORT_H
#define CANWIRE_PORT_PORT_H

#include "canwire.h"
#include "trace/errframe.h"

#define PORT_BATCH 64          /* frames of one read */
#define PORT_ERROR_TEXT_MAX 300 /* a path and why, as pathsocket.h has it */
#define PORT_BUFFER_BYTES (8 << 20) /* that a port asks for, for frames that wait to be read */

typedef struct port port;

/* A frame that an ECU wrote. It may be invalid (cw_frame_valid()): the bus counts it as such. */
typedef struct port_frame {
    cw_frame frame;
    int64_t realtime_ns; /* CLOCK_REALTIME of arrival; 0: unknown */
} port_frame;

/* Counters, all of them uint64_t. */
typedef struct port_stats {
    uint64_t read;            /* frames that were read for the bus */
    uint64_t read_failed;     /* reads that the kernel refused for reasons of its own */
    uint64_t written;         /* frames given to the ECU's interface; error frames not counted */
    uint64_t write_failed;    /* frames that the kernel did not take */
    uint64_t unheard;         /* frames for an ECU that was not connected; unix:PATH, fd:NUMBER */
    uint64_t kernel_dropped;  /* frames lost in the kernel before they could be read */
    uint64_t errors_written;  /* error frames given to the ECU's interface */
    uint64_t errors_failed;   /* error frames that the kernel did not take */
    uint64_t errors_left_out; /* error frames not written because there were too many */
    uint64_t errors_unheard; /* error frames for an ECU that was not connected */
    uint64_t errors_ignored; /* error frames that an ECU wrote itself; they never enter the bus */
    uint64_t malformed;      /* messages of an ECU that are no frames */
    uint64_t connected;      /* how often an ECU connected */
    uint64_t refused;        /* connections refused since an ECU was connected already */
    uint64_t loopless;       /* frames that programs sent without loopback: on vcan they are lost */
    uint64_t pushed_back;    /* how often it was not read for a while: the node's queue was full */
} port_stats;

void port_close(port *p);

/* Of the interface that it was opened on, which may have another name or be gone by now; 0 where
 * there is none. */
unsigned port_index(const port *p);

/* What the kernel has granted of PORT_BUFFER_BYTES, as net.core.rmem_max counts: when it is full,
 * more is dropped. All of it where an ECU waits instead. */
unsigned port_buffer_bytes(const port *p);

/* Readable when frames wait. */
int port_fd(const port *p);

/* Reads up to max frames that wait, from 1 to PORT_BATCH. Returns how many were put into frames;
 * *more tells whether to read again. */
unsigned port_read(port *p, port_frame frames[PORT_BATCH], unsigned max, bool *more);

/* Whether reading has begun to fail, *error an errno, or has ceased to, *error 0, since this was
 * asked last. That an interface is down or gone, or an ECU, is not meant. */
bool port_read_news(port *p, int *error);

/* So many frames have been sent on its interface without loopback since that was made, at least and
 * at most. Counts those since it was opened; the first call begins with the most, so that none from
 * before counts. counting: else only that is done. */
void port_count_loopless(port *p, int64_t least, int64_t most, bool counting);

/* Counts that it is not read for a while, since its node's queue is full. */
void port_pushed_back(port *p);

/* Writes a classical frame. False, and counted, when the kernel does not take it. */
bool port_write(port *p, const cw_frame *frame);

/* Writes an error frame, as a driver would give it to the ECU's programs. A storm of minor ones is
 * limited (errframe_limit_pass()); what is left out is counted. tick: bus time of the event. */
bool port_write_error(port *p, const errframe *frame, uint64_t tick);

/* Writes an error frame (CRTL RX_OVERFLOW) when more frames of the ECU are known to have been
 * lost in the kernel, ten times a second at most. tick: bus time. */
void port_tell_overflow(port *p, uint64_t tick);

void port_get_stats(port *p, port_stats *stats);

#endif
