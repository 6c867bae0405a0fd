/* SPDX-License-Identifier: MIT
 *
 * sim_trace.h - the bits of a run in virtual time, or a window of them, as VCD and as a picture.
 */
#ifndef CANWIRE_SIM_TRACE_H
#define CANWIRE_SIM_TRACE_H

#include "sim_run.h"
#include "svg.h"
#include "vcd.h"

typedef struct sim_trace {
    const sim_run *run; /* not owned */
    FILE *vcd_out;      /* NULL: not wanted; not owned */
    FILE *svg_out;
    uint64_t from; /* ticks; bits that overlap with the window are in it */
    uint64_t to;   /* CW_NEVER: to the end of the run */
    bool begun;    /* the run has reached the window */
    bool no_memory;
    bool left;     /* it has ended before the run */
    bool good;     /* ... and how */
    vcd *vcd;
    svg *svg;
} sim_trace;

/* Sets the window; either text may be NULL. False after a message that begins with `program`. */
bool sim_trace_window(sim_trace *self, const char *from, const char *to, const cfg *config,
                      const char *program);

/* Makes it look on; the outputs and the window are set. False after a message, when the window is
 * too long for a picture. */
bool sim_trace_start(sim_trace *self, sim_run *run, const char *program);

/* After the run: ends the outputs, which are then to be closed. False after a message, when there
 * is nothing in the window, or too much for a picture. */
bool sim_trace_finish(sim_trace *self, const char *program);

/* The run goes over to other nodes: what has been begun ends here, with a message; what has not
 * will show those nodes. */
void sim_trace_leave(sim_trace *self, const char *program);

/* Frees what is left, in any case. */
void sim_trace_close(sim_trace *self);

#endif
