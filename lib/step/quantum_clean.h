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
    unsigned slots;      /* index of its ACK slots in cw_clean */
    uint64_t drivers;    /* ... and their drivers */
    cw_span least_end;   /* no slot ends before, */
    cw_span late_end;    /* ... and not all of them before that; away nodes do not count, */
    cw_span most_end;    /* ... and none behind that */
    cw_span begun;       /* the node that sees the slot last sees it from then on, if not before, */
    cw_span leaves;      /* ... still does then, */
    cw_span released;    /* ... and does not from then on */
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

/* Counts bit times of clean frames, or between them, for load and statistics. */
static inline void cw_clean_count_bits(cw_bus *bus, uint64_t bits, bool busy)
{
    bus->stats.busy_bits += busy ? bits : 0;
    if (bits > 0)
        cw_load_add(&bus->load, bits * bus->load.unit, busy);
}

/* ---- quantum_edge.c -------------------------------------------------------------------------- */

/* Plans the ACK slot of each node. Returns false when an edge may come too early or too late for a
 * node. Then a sample of the slot, or of a bit beside it, may go wrong. */
bool cw_clean_acknowledge(cw_bus *bus, cw_clean_frame *frame);

/* Returns how far behind the planned start of its ACK slot the first acknowledgement comes to a
 * node, its own one included. slots: index of the slots. */
static inline cw_span cw_clean_behind(const cw_clean *clean, unsigned slots,
                                      const cw_clean_node *node)
{
    const cw_clean_slot *slot = &node->slot[slots];
    return (clean->at_one_place ? clean->slots[slots].seen + node->from_below : slot->arrival) -
           slot->ack;
}

/* Returns a moment from which on a node sees the slot for sure, if not before, that sees it up to
 * another one. A driver is dominant for a bit, but for the quantum that an early edge may take. */
static inline cw_span cw_clean_begun(const cw_clean *clean, cw_span released)
{
    return released - clean->least_bit + clean->most_quantum + clean->most_skew;
}

/* Returns the end of its ACK slot (T4 to T6, T12), which is the start of the ACK delimiter. */
cw_span cw_clean_end_of_slot(const cw_clean *clean, unsigned slots, const cw_clean_node *node);

/* Returns that of the last frame. All nodes are parked. */
static inline cw_span cw_clean_delimiter(const cw_clean *clean, unsigned node)
{
    return cw_clean_end_of_slot(clean, clean->last, cw_clean_at(clean, node));
}

/* ---- quantum_level.c ------------------------------------------------------------------------- */

/* The last recessive edge behind ACK slots, for each end of the line. */
typedef struct cw_last_release {
    bool found;
    cw_span key[2];   /* when it would come to place 0 if it went on so far */
    cw_span other[2]; /* the same of the last edge of another node ... */
    unsigned node[2]; /* ... than this one */
} cw_last_release;

/* Finds the last edges behind the ACK slots of all drivers of a frame. */
void cw_clean_find_release(cw_last_release *release, const cw_clean *clean,
                           const cw_clean_frame *frame);

/* Returns the arrival of the last of them at a node. slots: index of the slots. */
cw_span cw_clean_released_at(const cw_clean *clean, const cw_last_release *release, unsigned slots,
                             const cw_clean_node *node);

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

/* A frame that is counted. */
typedef struct cw_frame_count {
    const cw_clean_frame *frame;
    cw_frame_edges edges;
    cw_last_release release;
} cw_frame_count;

/* Counts the synchronisations and margins of a node, whose slot has been ended. The hard
 * synchronisation to SOF is left to the caller. */
void cw_clean_count(const cw_bus *bus, cw_frame_count *count, const cw_clean_node *node);

/* Returns how far behind the start of its quantum the edge of SOF comes to a receiver. It takes the
 * bits to be as they are in the ACK slot. The difference to one quantum is that by which they
 * turn. */
cw_span cw_clean_offset_at_sof(const cw_bus *bus, const cw_clean_frame *frame,
                               const cw_clean_node *node);

/* ---- quantum_pass.c -------------------------------------------------------------------------- */

/* Returns the `quiet` of a node. */
cw_span cw_clean_quiet(const cw_bus *bus, const cw_clean_node *node);

/* Counts the synchronisations and margins of a frame for all nodes. */
void cw_clean_pass(cw_bus *bus, const cw_clean_frame *frame);

/* Gives the records what they do not have yet. */
void cw_clean_take_counts(cw_bus *bus);

#endif
