/* SPDX-License-Identifier: MIT
 *
 * timed.h - nodes with clocks of their own. It has the place of each one in its bit, the next
 * thing that it does, and the line between them. The bus uses it while it is off the grid of common
 * bits, see step/quantum.c.
 */
#ifndef CANWIRE_STATE_TIMED_H
#define CANWIRE_STATE_TIMED_H

#include "canwire.h"
#include "rule/disturb.h"
#include "time/cable.h"
#include "time/fast.h"
#include "time/pcs.h"

/* The next thing that a node does. At one moment all looks come first, then all ends, then all
 * starts. */
typedef enum cw_doing {
    CW_LOOKS = 0, /* at the wire, to sample it, or because an edge may have come */
    CW_ENDS,      /* its bit */
    CW_BEGINS,    /* its next bit */
} cw_doing;

/* A synchronisation. A bit has one before its sample point at most, and one after it. */
typedef struct cw_sync {
    bool hard;
    int16_t phase_error; /* in quanta */
} cw_sync;

#define CW_SYNCS_OF_BIT 2

/* Its size is a power of two: an index costs one shift then. */
typedef struct cw_timed_node {
    cw_pcs pcs;
    bool driven;        /* the level that it puts onto its wire */
    bool ahead;         /* its next bit begins at next_begin with nothing to do, so that the agenda
                           has the sample point of that bit */
    bool deaf;          /* no edge moves it before its next sample, whatever came since (D12) */
    bool retimed;       /* it has another bit timing from the next bit on: next_timings */
    uint8_t sync_count;
    cw_sync syncs[CW_SYNCS_OF_BIT]; /* to be committed at the end of the bit */
    cw_span begin;      /* of the present bit, that of its Sync_Seg */
    cw_span next_begin; /* of the next one, while the node ends and begins bits */
    cw_span looked;     /* edges that came before the look at this moment have been dealt with */
    cw_span first_arrival; /* of a dominant edge of the present rise, see cw_cable */
    cw_span last_arrival;  /* of any dominant edge so far */
    cw_bit_timing timing;
    cw_pcs begun;      /* the start of any bit, by the bit timing */
    cw_span to_sample; /* from there to the sample point, when no edge moves it */
    cw_mac_report report; /* of the last sample, to be committed, too */
} cw_timed_node;

/* An entry of the agenda: moment, then what, then node. */
typedef struct cw_agenda_entry {
    cw_span moment;
    uint16_t what; /* cw_doing << 8 | node */
} cw_agenda_entry;

/* Entries, sorted. */
typedef struct cw_agenda_list {
    cw_agenda_entry entries[2 * CW_NODES_MAX + 1]; /* behind the last one: CW_SPAN_MAX */
    cw_agenda_entry *first;
    cw_agenda_entry *behind; /* the last one */
} cw_agenda_list;

/* The next thing of each node: looks, ends and starts. A bit that begins comes before nearly all
 * looks, so that one list would be moved about. */
typedef struct cw_agenda {
    cw_agenda_list looks;
    cw_agenda_list others;
} cw_agenda;

/* The wires of nodes, as sets of nodes. */
typedef struct cw_wires {
    uint64_t nodes[CW_NODES_MAX];
    unsigned count; /* 1: all nodes are on one wire */
} cw_wires;

/* The ACK slot of a node in a clean frame. */
typedef struct cw_clean_slot {
    cw_span ack;     /* its start, if nobody acknowledged */
    cw_span arrival; /* of the first acknowledgement, if edges go along a line */
} cw_clean_slot;

/* All ACK slots of a frame. */
typedef struct cw_clean_slots {
    uint64_t drivers;
    cw_span seen; /* the key of the first acknowledgement, if all nodes are at one place */
} cw_clean_slots;

/* A node in clean frames. Spans are by its bit timing and its way, levels are indices. Keys are
 * moments at which edges would come to place 0 of the line, or are part of one. */
typedef struct cw_clean_node {
    cw_span quantum;
    cw_span bit;
    cw_span origin;       /* the start of some quantum: these never move */
    cw_clean_slot slot[2]; /* of the last frame, and of the next one: see `last` of cw_clean */
    cw_span down;         /* ack + down: key of the acknowledgement that goes up the line, */
    cw_span up;           /* ... and of the one that goes down; later than any for those that do not
                             acknowledge */
    cw_span from_below;   /* key + from_below: the arrival of an edge that goes up, */
    cw_span from_above;   /* ... and of one that goes down */
    cw_span quiet;        /* an acknowledgement that far behind `ack` is nothing new to count */
    uint64_t resyncs;     /* resynchronisations that its record does not have yet */
    uint64_t unheard;     /* frames of cw_clean at whose SOF it did not synchronise */
    unsigned node;
    cw_span place;
    cw_span out[2];       /* the delay of its edges up to the line, its stub included */
    cw_span in[2];        /* ... from there to it */
    cw_span own[2];       /* ... from it to itself */
    cw_span to_sample;    /* from the start of a bit */
    cw_span to_first_look; /* ... to the first of three looks for a sample (T7) */
    cw_span sjw;
    cw_span last_arrival; /* the longest delay of a recessive edge from it */
    cw_span near;         /* the shortest delay of a dominant edge to another node, */
    cw_span far;          /* ... and the longest one */
    cw_span round;        /* the longest delay of such an edge and of a recessive one after it */
    bool sure;            /* all who acknowledge read its ACK slots right */
    uint64_t harmless;    /* nodes that read it right, or not at all, see step/quantum_proof.c */
} cw_clean_node;

/* All nodes in clean frames, and between them. */
typedef struct cw_clean {
    bool valid;          /* the nodes are by the present bit timings and ways */
    bool at_one_place;   /* no edge has to go along a line */
    cw_span least_delay; /* of a dominant edge from a node to another one */
    cw_span most_skew;   /* by which edges to recessive are under way for longer, or shorter */
    cw_span least_quantum;
    cw_span most_quantum;
    cw_span most_out;    /* of dominant edges */
    cw_span least_bit;
    cw_span most_bit;
    cw_span drift;       /* most difference of two nodes from an edge to the ACK slot */
    cw_span least_behind; /* from a sample point to the end of the bit */
    cw_span most_behind;
    cw_span least_look;  /* to_first_look */
    cw_clean_node *nodes; /* in the order of their places on the line */
    uint8_t *at;         /* index of each node there */
    bool parked;         /* all nodes are between two frames, and their places are here */
    unsigned last;       /* index of the slots of the last frame */
    cw_clean_slots slots[2];
    cw_span late_end;    /* limits of the last end of these slots */
    cw_span most_end;
    uint64_t away;       /* nodes that are off, in bus-off or asleep */
    uint64_t drivers;    /* nodes that acknowledge */
    uint64_t senders;    /* nodes that have been the transmitters of the last frame */
    uint64_t heard;      /* frames whose hard synchronisations the records do not have yet */
} cw_clean;

#define CW_NO_KEY (CW_SPAN_MAX / 4) /* later than any key */

/* The swing of the wire at a node, after edges to recessive that come after a moment. */
typedef struct cw_ringing {
    cw_span now;
    cw_span since;
    cw_span former; /* for looks up to `since`: nodes look at quanta that have passed, too */
    cw_span former_since;
} cw_ringing;

/* The two rates of a node (D10). */
typedef struct cw_timed_rates {
    cw_bit_timing nominal;
    cw_bit_timing data;   /* the nominal bit timing where it has no other one */
    cw_data_timing given; /* by the host */
    cw_data_timing next;  /* ... of nodes that are `retimed` */
    bool fast;            /* the present bit goes by the data rate, after the sample point of BRS */
    cw_late_compare late;
    cw_data_stats stats;
} cw_timed_rates;

/* Nodes whose levels rules have changed in a bit time, after its start. */
typedef struct cw_bit_faults {
    uint64_t tx;
    uint64_t wire;
    uint64_t rx;
} cw_bit_faults;

typedef struct cw_timed {
    bool active;    /* the bus is off the grid */
    bool divides;   /* bits are short enough to be divided */
    bool uniform;   /* all nodes have the bit timing of the bus, and no delays */
    uint64_t short_ticks; /* by which busy bits so far were shorter than nominal ones */
    bool rings;     /* the wire swings at some node after edges to recessive, or has done so */
    bool rings_before; /* it swung otherwise before the last change, and nodes still look there */
    bool requested; /* by cw_bus_set_own_clocks() */
    unsigned bits_of_bit_time; /* of a node that can end in one bit time of the bus */
    uint64_t touched; /* nodes whose controllers have been changed from outside */
    uint32_t fastest_permille; /* the shortest bit of a node, in thousandths of a bit time, less
                                  than 1000 */
    uint64_t steady_at; /* tick of a bit time that begins as the one before it did: no controller
                           has had a report or is in another phase. CW_NEVER: none */
    unsigned view;      /* of the wire, up to then, see cw_view_wire() */
    uint64_t epoch; /* tick; moments count from here */
    cw_cable cable;
    cw_disturbances disturbances;
    cw_span moment; /* all has been done up to it */
    cw_wires wires;      /* after the moment at which they changed */
    cw_wires old_wires;  /* ... and before it */
    cw_span rewired_at;
    bool one_wire;       /* there is one wire, and has been for as long as anybody looks back */
    cw_agenda agenda;
    cw_ringing *ringing; /* of each node */
    cw_span bit_time;    /* of the bus */
    cw_span longest;     /* no edge is under way for longer, but for rules on jitter */
    cw_timed_node *nodes;
    cw_bit_timing *next_timings; /* of nodes that are `retimed` */
    cw_timed_rates *rates;       /* of each node; NULL: no node has a data rate */
    cw_fast_bits fast;   /* of clean frames, where bits are common to all nodes */
    cw_sync_record *records; /* of each node; NULL: nothing is counted */
    bool counts;             /* in this bit time */
    bool calm;               /* nothing acts on levels, and nothing is marked, see is_calm() */
    bool reports_syncs;      /* by events, in this bit time */
    cw_clean clean;
    bool marking;            /* in this bit time */
    cw_mark *marks;          /* of this bit time */
    unsigned mark_room;
    unsigned mark_count;
    unsigned noted_marks;    /* those before the levels at the start of the bit time were noted */
    uint64_t noted_dominant; /* nodes that drove dominant just then */
    bool together;           /* all bits began with the bit time, but of nodes that nobody sees */
    cw_bit_faults faults;
} cw_timed;

/* ---- agenda.c -------------------------------------------------------------------------------- */

void cw_agenda_clear(cw_agenda *agenda);

static inline cw_doing cw_agenda_what(const cw_agenda_entry *entry)
{
    return (cw_doing)(entry->what >> 8);
}

static inline unsigned cw_agenda_node(const cw_agenda_entry *entry)
{
    return entry->what & 0xFFu;
}

static inline bool cw_agenda_before(const cw_agenda_entry *a, const cw_agenda_entry *b)
{
    return a->moment != b->moment ? a->moment < b->moment : a->what < b->what;
}

/* Moves the entries to the front of the array, since they have come to its end. */
void cw_agenda_make_room(cw_agenda_list *list);

/* Adds what a node does next; it must have no entry. */
static inline void cw_agenda_put(cw_agenda *agenda, unsigned node, cw_doing what, cw_span moment)
{
    const cw_agenda_entry entry = {.moment = moment,
                                   .what = (uint16_t)((unsigned)what << 8 | node)};
    cw_agenda_list *list = what == CW_LOOKS ? &agenda->looks : &agenda->others;
    if (list->behind == list->entries + 2 * CW_NODES_MAX)
        cw_agenda_make_room(list);
    cw_agenda_entry *place = list->behind++;
    list->behind->moment = CW_SPAN_MAX;
    for (; place > list->first && cw_agenda_before(&entry, place - 1); place--)
        *place = place[-1];
    *place = entry;
}

/* Returns the entry of a node. */
const cw_agenda_entry *cw_agenda_of(const cw_agenda *agenda, unsigned node);

/* Takes the entry of a node away. */
void cw_agenda_remove(cw_agenda *agenda, unsigned node);

/* Returns the first entry. Looks come before others at the same moment. */
static inline const cw_agenda_entry *cw_agenda_first(const cw_agenda *agenda)
{
    const cw_agenda_entry *look = agenda->looks.first, *other = agenda->others.first;
    return other->moment < look->moment ? other : look;
}

/* Takes the first entry away, which says what is done. */
static inline void cw_agenda_take(cw_agenda *agenda, cw_doing what)
{
    if (what == CW_LOOKS)
        agenda->looks.first++;
    else
        agenda->others.first++;
}

/* Returns a node in clean frames. */
static inline cw_clean_node *cw_clean_at(const cw_clean *clean, unsigned node)
{
    return &clean->nodes[clean->at[node]];
}

/* Moves the epoch forward. */
void cw_agenda_rebase(cw_agenda *agenda, cw_span by);

/* Gives a node its bit timing. */
static inline void cw_timed_set_timing(cw_timed_node *n, const cw_bit_timing *timing)
{
    n->timing = *timing;
    n->to_sample = timing->quantum * cw_bit_timing_sample_at(timing);
    cw_pcs_begin_bit(&n->begun, timing);
}

/* Returns the bit timing of a node at one of its rates. */
static inline const cw_bit_timing *cw_timing_at(const cw_timed_rates *rates, bool fast)
{
    return fast ? &rates->data : &rates->nominal;
}

/* Begins the next bit of a node, at its planned start or with the quantum of an edge. */
static inline void cw_timed_begin(cw_timed_node *n)
{
    n->begin = n->looked = n->next_begin;
    n->pcs.sample_at = n->begun.sample_at;
    n->pcs.end_at = n->begun.end_at;
    n->pcs.sampled = false;
}

/* Makes a node that is ahead begin its bit as others do: it has begun, or that is on the agenda.
 * This comes before a controller or its bit timing is changed, since it may drive another level
 * then. It also comes before rules act, since they have to see the start. */
void cw_timed_settle(cw_timed *timed, unsigned node);

/* Makes nodes take the edges that have come up to now. This comes before levels of the past become
 * other ones, by another ringing, other wires or another line. */
void cw_timed_catch_up(cw_bus *bus);

/* Returns how long the wire swings at a node, or swung before the last change that still counts. */
static inline cw_span cw_timed_longest_ringing(const cw_timed *timed, unsigned node)
{
    const cw_ringing *r = &timed->ringing[node];
    return r->now > r->former ? r->now : r->former;
}

/* Lets the wire swing as it does now, also after edges that came before. */
void cw_timed_begin_ringing(cw_timed *timed);

/* Changes how long the wire swings at a node, after edges that come from now on. */
void cw_timed_set_ringing(cw_timed *timed, unsigned node, cw_span ringing);

#endif
