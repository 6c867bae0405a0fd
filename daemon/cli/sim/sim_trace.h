/* SPDX-License-Identifier: MIT
 *
 * sim_trace.h - the bits of a run in virtual time, or a window of them, as VCD and as a picture.
 */
#ifndef CANWIRE_CLI_SIM_SIM_TRACE_H
#define CANWIRE_CLI_SIM_SIM_TRACE_H

#include "cli/outfile.h"
#include "cli/svg/svg.h"
#include "record/vcd.h"
#include "sim/sim_run.h"

/* A time on the command line. */
typedef struct time_option {
    const char *text; /* NULL: it is not given */
    cfg_time time;
} time_option;

typedef struct sim_trace {
    const sim_run *run; /* not owned */
    outfile *vcd_out;   /* not owned; an output that is not open is not wanted */
    outfile *svg_out;
    uint64_t from; /* ticks; bits that overlap with the window are in it */
    uint64_t to;   /* CW_NEVER: to the end of the run */
    bool begun;    /* the run has reached the window */
    bool no_memory;
    bool left;     /* it has ended before the run */
    bool good;     /* ... and how */
    vcd *vcd;
    svg *svg;
} sim_trace;

/* Sets the window; either end may be NULL. Returns false after a message that begins with `program`
 * when the window is empty. */
bool sim_trace_window(sim_trace *self, const time_option *from, const time_option *to,
                      const cfg *config, const char *program);

/* Makes it observe; the outputs and the window are set. `end` is the tick at which the run ends,
 * CW_NEVER: unknown. Returns false after a message when the window is too long for a picture or
 * begins after the run. */
bool sim_trace_start(sim_trace *self, sim_run *run, uint64_t end, const char *program);

/* Begins the outputs whose window starts with the run; call it right before the run. */
void sim_trace_begin(sim_trace *self);

/* Ends the outputs after the run; they must then be closed. Returns false after a message when the
 * window is empty or too long for a picture. */
bool sim_trace_finish(sim_trace *self, const char *program);

/* Handles a change to other nodes. Outputs that have begun end here, with a message; others will
 * show the new nodes. */
void sim_trace_leave(sim_trace *self, const char *program);

/* Frees the rest, in any case. */
void sim_trace_close(sim_trace *self);

#endif
