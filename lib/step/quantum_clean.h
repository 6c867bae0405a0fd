/* SPDX-License-Identifier: MIT
 *
 * quantum_clean.h - declarations that the parts of clean frames by own clocks share.
 *
 *   quantum_proof.c  which nodes read each other right
 *   quantum_park.c   where nodes are between two frames
 *   quantum_frame.c  when a frame can pass at once, and what it brings
 *   quantum_edge.c   its acknowledgement
 *   quantum_pass.c   the places of nodes behind it; what it brings that is new to their records
 *   quantum_count.c  the synchronisations and margins of one node
 *   quantum_level.c  the level of the wire at single moments
 */
#ifndef CANWIRE_STEP_QUANTUM_CLEAN_H
#define CANWIRE_STEP_QUANTUM_CLEAN_H

#include "step/quantum.h"

/* A frame on its way. Bits are counted from SOF. */
typedef struct cw_clean_frame {
    unsigned sender;
    const cw_frame *frame;
    uint64_t due;        /* tick at which it comes out of the inbox; 0: it waits */
    unsigned length;     /* bits, SOF to EOF */
    unsigned edge;       /* the last bit before the ACK slot that begins with an edge to dominant */
    unsigned slot;       /* the ACK slot */
    cw_span bit;         /* of the sender */
    cw_span now;         /* the start of the step */
    cw_span begin;       /* of SOF */
    cw_span until;       /* the end of the step */
    uint64_t bit_times;  /* of the step */
    uint64_t drivers;    /* of the ACK slot */
    cw_span first;       /* the first planned edge of a driver comes to the line, */
    cw_span seen;        /* ... and its key, where all nodes are at one place */
    cw_span most_ack;    /* no slot is planned to begin later */
    cw_span least_end;   /* limits of the ends of all slots, */
    cw_span most_end;
    cw_span first_end;   /* ... and of the first one of a driver, */
    cw_span last_end;    /* ... and of the last one: it is not before */
    cw_span released;    /* the wire is recessive everywhere from then on */
} cw_clean_frame;

/* ---- quantum_proof.c ------------------------------------------------------------------------- */

/* Finds what clean frames need to know of nodes, by the present bit timings and ways. */
void cw_clean_prove(cw_bus *bus);

/* ---- quantum_park.c -------------------------------------------------------------------------- */

/* Parks all nodes, if they are not parked. Returns false when a node has more to do than to wait
 * for a frame. */
bool cw_clean_park(cw_bus *bus);

/* Returns how many of the next bit times begin before the end of the last frame and its
 * intermission. All nodes are parked. */
uint64_t cw_clean_busy_bits(const cw_bus *bus);

/* Returns the first start of a bit of a parked node at which it can begin a frame, at or after a
 * moment. */
cw_span cw_clean_ready(const cw_bus *bus, unsigned node, cw_span moment);

/* Returns true when all nodes, which are parked, take an edge at a moment for SOF. */
bool cw_clean_takes_sof(const cw_bus *bus, cw_span moment);

/* ---- quantum_edge.c -------------------------------------------------------------------------- */

/* Plans the ACK slot of each node. Returns false when an edge may come too early or too late for a
 * node. Then a sample of the slot, or of a bit beside it, may go wrong. */
bool cw_clean_acknowledge(cw_bus *bus, cw_clean_frame *frame);

/* Returns the moment at which the first acknowledgement comes to a node, its own one included. */
static inline cw_span cw_clean_arrival(const cw_clean *clean, const cw_clean_frame *frame,
                                       const cw_clean_node *node)
{
    return clean->at_one_place ? frame->seen + node->from_below : node->arrival;
}

/* Returns the end of its ACK slot (T4 to T6, T12). */
cw_span cw_clean_end_of_slot(const cw_clean *clean, const cw_clean_frame *frame,
                             const cw_clean_node *node);

/* ---- quantum_level.c ------------------------------------------------------------------------- */

/* Returns the recessive bit times at the end of that many ones of the step. Not for each frame: it
 * looks at all nodes at the end of each bit time. */
uint64_t cw_clean_recessive_bits(const cw_bus *bus, const cw_clean_frame *frame,
                                 uint64_t bit_times);

/* ---- quantum_count.c ------------------------------------------------------------------------- */

#define CW_EDGE_WORDS 3u /* of the longest classical frame */
#define CW_EDGE_GAP 10   /* bits between two edges to dominant, at most */

/* The edges of a frame from SOF to the CRC delimiter, as sets of the bits that begin with them.
 * They are found when they are needed. */
typedef struct cw_frame_edges {
    bool found;
    uint64_t to[2][CW_EDGE_WORDS]; /* by their level */
} cw_frame_edges;

/* Limits of the times from the start of a receiver's bit to edges that begin it. */
typedef struct cw_offsets {
    cw_span least;
    cw_span most;
} cw_offsets;

/* The last recessive edge behind ACK slots, for each end of the line. */
typedef struct cw_last_release {
    bool found;
    cw_span key[2];   /* when it would come to place 0 if it went on so far */
    cw_span other[2]; /* the same of the last edge of another node ... */
    unsigned node[2]; /* ... than this one */
} cw_last_release;

/* A frame that is counted. */
typedef struct cw_frame_count {
    const cw_clean_frame *frame;
    cw_frame_edges edges;
    cw_last_release release;
} cw_frame_count;

/* Counts the synchronisations and margins of a node, whose slot has been ended. The hard
 * synchronisation to SOF is left to the caller. */
void cw_clean_count(const cw_bus *bus, cw_frame_count *count, const cw_clean_node *node);

/* Returns how far behind the start of its quantum the edge of SOF comes to a receiver. Its slot has
 * been planned by that. */
cw_span cw_clean_phase(const cw_bus *bus, const cw_clean_frame *frame, const cw_clean_node *node);

/* ---- quantum_pass.c -------------------------------------------------------------------------- */

/* Returns the `quiet` of a node. */
cw_span cw_clean_quiet(const cw_bus *bus, const cw_clean_node *node);

/* Ends the ACK slots of all nodes, and counts the synchronisations and margins of the frame. */
void cw_clean_pass(cw_bus *bus, const cw_clean_frame *frame);

/* Gives the records what they do not have yet. */
void cw_clean_take_counts(cw_bus *bus);

#endif
