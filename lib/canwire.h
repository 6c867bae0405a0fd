/* SPDX-License-Identifier: MIT
 *
 * canwire.h - the only public header of libcanwire, a CAN bus simulated bit by bit.
 *
 * The library is passive: no system call, no clock, no allocation, no global state, no floating
 * point. The same inputs give the same outputs on every machine. Four layers can be used alone:
 *
 *   1. Frames: cw_frame and its encoding to wire bits, cw_bits.
 *   2. The controller: cw_mac, one CAN controller driven bit by bit (the test-bench interface).
 *   3. The controller in time: cw_timed_mac, driven by its clock or its time quantum.
 *   4. The bus: cw_bus, up to 64 nodes on one wire, in ticks, with queues, faults and statistics.
 *
 * Names like M6, E3, R8, T5 are the rules of RULES.md, which restates ISO 11898-1.
 * Levels: dominant is 0 (false), recessive is 1 (true). Nothing here is thread safe; objects share
 * nothing, so different threads may use different objects.
 */
#ifndef CANWIRE_H
#define CANWIRE_H

#include "canwire_counters.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define CW_DOMINANT false
#define CW_RECESSIVE true

#define CW_NODES_MAX 64            /* nodes of one bus; a set of nodes is a uint64_t mask */
#define CW_FRAME_DATA_MAX 64       /* bytes of the longest data field */
#define CW_CLASSICAL_DATA_MAX 8    /* ... in a classical frame */
#define CW_BITS_MAX 768            /* wire bits of the longest frame (731), rounded up */
#define CW_QUEUE_MAX 4096          /* frames in the transmit queue of one node */
#define CW_RULES_MAX 1024          /* fault rules of one bus */
#define CW_RULE_FILTERS_MAX 8      /* frame filters of one rule */
#define CW_WAKE_FILTERS_MAX 8      /* frames that wake a node */
#define CW_RULE_NAME_MAX 64        /* bytes of a rule name that count, the rest is ignored */
#define CW_CLOCK_HZ 80000000u      /* one tick is 1 / 80 MHz = 12.5 ns */
#define CW_NEVER UINT64_MAX        /* a tick that never comes */
#define CW_NO_NODE UINT8_MAX       /* in place of the index of a node */

typedef enum cw_status {
    CW_OK = 0,
    CW_FULL,     /* no room: poll events (advance) or advance the bus (send), then call again */
    CW_INVALID,  /* an argument is outside its documented range; nothing was changed */
    CW_REFUSED,  /* not possible in the present state; nothing was changed */
    CW_AGAIN,    /* stopped early, so that others get their turn: call again */
} cw_status;

/* ---- Bits and time --------------------------------------------------------------------------- */

/* The length of bits. Only the functions here and lib/time read its field; all others call them. */
typedef struct cw_rate {
    uint32_t bit_ticks;
} cw_rate;

/* bit_ticks: ticks of one bit, at least 1. */
static inline cw_rate cw_rate_of(uint32_t bit_ticks)
{
    return (cw_rate){.bit_ticks = bit_ticks};
}

/* Returns how many ticks that many bits last. The product must fit into 64 bits. */
static inline uint64_t cw_rate_ticks(cw_rate rate, uint64_t bits)
{
    return bits * rate.bit_ticks;
}

/* Returns the same for any number of bits, and CW_NEVER beyond the end of time. */
static inline uint64_t cw_rate_ticks_or_never(cw_rate rate, uint64_t bits)
{
    uint64_t ticks;
    return __builtin_mul_overflow(bits, rate.bit_ticks, &ticks) ? CW_NEVER : ticks;
}

/* Returns the number of whole bits in that many ticks. */
static inline uint64_t cw_rate_bits(cw_rate rate, uint64_t ticks)
{
    return ticks / rate.bit_ticks;
}

/* Returns the number of bits that begin in that many ticks, the first of them at the first tick. */
static inline uint64_t cw_rate_bits_begun(cw_rate rate, uint64_t ticks)
{
    return ticks / rate.bit_ticks + (ticks % rate.bit_ticks != 0);
}

/* Returns the tick at which the bit that contains a tick begins. The first bit of a bus begins at
 * tick 0. */
static inline uint64_t cw_rate_bit_begin(cw_rate rate, uint64_t tick)
{
    return tick - tick % rate.bit_ticks;
}

/* Returns the first tick at or after another at which a bit begins; CW_NEVER beyond the end of
 * time. */
static inline uint64_t cw_rate_next_bit(cw_rate rate, uint64_t tick)
{
    return cw_rate_ticks_or_never(rate, cw_rate_bits_begun(rate, tick));
}

/* Returns the tick that many ticks after another; CW_NEVER beyond the end of time. */
static inline uint64_t cw_after(uint64_t tick, uint64_t ticks)
{
    return ticks < CW_NEVER - tick ? tick + ticks : CW_NEVER;
}

/* ---- Time inside the bit --------------------------------------------------------------------- */

/* A length of time in 2^-32 ticks, which no rounding of 1 ns can leave. One tick is CW_TICK. */
typedef int64_t cw_span;

#define CW_TICK (INT64_C(1) << 32)
#define CW_BIT_QUANTA_MAX 1024u /* time quanta of one bit */

/* The bit timing of one controller (T1). A bit has 1 quantum of Sync_Seg, then Prop_Seg,
 * Phase_Seg1, the sample point, and Phase_Seg2. */
typedef struct cw_bit_timing {
    cw_span quantum;      /* one time quantum, with the error of the clock: 1..2^53 - 1 */
    uint16_t prop_seg;    /* quanta, 0 or more */
    uint16_t phase_seg1;  /* quanta, 1 or more */
    uint16_t phase_seg2;  /* quanta, 1 or more */
    uint16_t sjw;         /* quanta, 1 to the smaller phase segment */
    bool triple_sampling; /* T7 */
} cw_bit_timing;

/* Returns one time quantum: brp clocks at clock_hz, rounded to the nearest 2^-32 tick. ppm is the
 * error of the clock in millionths; a positive one is fast. Ranges are clock_hz from 1, brp
 * 1..65536, ppm -500000..500000. Returns 0 outside of them, and when the quantum is longer than
 * 26 ms. */
cw_span cw_quantum(uint32_t clock_hz, uint32_t brp, int32_t ppm);

/* Returns the quanta of a bit, and of the part up to the sample point. */
unsigned cw_bit_timing_quanta(const cw_bit_timing *timing);
unsigned cw_bit_timing_sample_at(const cw_bit_timing *timing);

/* Returns true when all values are in the ranges above and the bit has at most CW_BIT_QUANTA_MAX
 * quanta. Controllers that exist allow less. */
bool cw_bit_timing_valid(const cw_bit_timing *timing);

/* The physical coding sublayer of one controller: its place in a bit. The fields are the
 * library's. */
typedef struct cw_pcs {
    uint16_t sample_at;  /* quanta from the start of the bit, as synchronisation has moved them */
    uint16_t end_at;
    bool sampled;        /* this bit has been sampled */
    bool last_sample;    /* level of the last sample */
    bool synchronised;   /* since the last sample point (T3) */
} cw_pcs;

/* ---- Frames ---------------------------------------------------------------------------------- */

#define CW_FRAME_EXTENDED 0x01u /* 29-bit identifier */
#define CW_FRAME_REMOTE 0x02u   /* remote frame: no data field, whatever the DLC says (F3) */
#define CW_FRAME_FD 0x04u       /* CAN FD frame (D1); it cannot be remote */
#define CW_FRAME_BRS 0x08u      /* its bit rate switch: the data phase is faster (D10) */
#define CW_FRAME_ESI 0x10u      /* its error state indicator: the transmitter is passive (D8). The
                                   controller that sends it sets it */
#define CW_FRAME_NON_ISO 0x20u  /* FD frame in the format from before ISO 11898-1:2015. Controllers
                                   and buses set it in all FD frames, or in none */
#define CW_FRAME_CUT 0x80u      /* in place of CW_FRAME_FD, in events of buses without FD: of a
                                   dropped FD frame the first 8 bytes at most are there */

#define CW_BASE_ID_MAX 0x7FFu
#define CW_EXTENDED_ID_MAX 0x1FFFFFFFu

typedef struct cw_frame {
    uint32_t id;    /* 0..CW_BASE_ID_MAX, or 0..CW_EXTENDED_ID_MAX with CW_FRAME_EXTENDED */
    uint8_t flags;  /* CW_FRAME_* */
    uint8_t dlc;    /* 0..15, the raw code on the wire (F4, D2) */
    uint8_t data[CW_FRAME_DATA_MAX]; /* the first cw_frame_length() bytes count */
} cw_frame;

/* Returns the bytes in the data field: 0 for a remote frame, up to 64 for an FD frame (D2). For DLC
 * 9..15 of a classical frame it is 8 (F3, F4). */
unsigned cw_frame_length(const cw_frame *frame);

/* Returns the least DLC of an FD frame whose data field has room for that many bytes, at most 64
 * (D2). */
unsigned cw_fd_dlc(unsigned bytes);

/* Returns true when a bus can carry the frame: identifier in range, DLC <= 15, flags that go
 * together. An FD frame needs a bus with FD nodes. */
bool cw_frame_valid(const cw_frame *frame);

/* Returns the stuff bits that SOF and the identifier have, with SRR and IDE of an extended one. Two
 * bit errors at a stuff bit may escape the CRC, so identifiers without one are recommended. */
unsigned cw_frame_id_stuff_bits(const cw_frame *frame);

/* Returns true when both frames are the same on the wire: id, format, remote, DLC and data
 * bytes. */
bool cw_frame_equal(const cw_frame *a, const cw_frame *b);

/* ---- Random numbers -------------------------------------------------------------------------- */

/* Returns number n of the random stream that belongs to a name under a seed. Fault rules have such
 * streams. A stream depends on nothing else. At most CW_RULE_NAME_MAX bytes of the name count. */
uint64_t cw_random(uint64_t seed, const char *name, uint64_t n);

/* ---- Positions ------------------------------------------------------------------------------- */

typedef enum cw_field {
    CW_FIELD_NONE = 0,
    CW_FIELD_SOF,
    CW_FIELD_ID, /* index 0..28: id28 first in an extended frame; 0..10 in a base frame */
    CW_FIELD_SRR,
    CW_FIELD_IDE,
    CW_FIELD_RTR,
    CW_FIELD_R1,
    CW_FIELD_R0,
    CW_FIELD_FDF, /* in the place of r0 of a base frame, of r1 of an extended one (D1) */
    CW_FIELD_RES,
    CW_FIELD_BRS,
    CW_FIELD_ESI,
    CW_FIELD_DLC,
    CW_FIELD_DATA, /* index 8 * byte + bit, bit 0 is the most significant */
    CW_FIELD_STUFF_COUNT, /* three bits and their parity (D5) */
    CW_FIELD_CRC,
    CW_FIELD_FIXED_STUFF, /* index: number of the fixed stuff bit in the frame (D4) */
    CW_FIELD_CRC_DELIMITER,
    CW_FIELD_ACK_SLOT, /* index 0 and 1 in an FD frame (D7) */
    CW_FIELD_ACK_DELIMITER,
    CW_FIELD_EOF,
    CW_FIELD_INTERMISSION,
    CW_FIELD_SUSPEND,
    CW_FIELD_ERROR_FLAG,
    CW_FIELD_ERROR_DELIMITER,
    CW_FIELD_OVERLOAD_FLAG,
    CW_FIELD_OVERLOAD_DELIMITER,
    CW_FIELD_STUFF, /* fault positions only: the index-th stuff bit of the frame */
    CW_FIELD_BIT,   /* fault positions only: the index-th wire bit, stuff bits counted, 0 is SOF */
    CW_FIELD_COUNT
} cw_field;

/* Returns the name used in events and fault rules ("ack-delimiter"), a constant string. */
const char *cw_field_name(cw_field field);

/* Returns the most bits that the field can have, in classical frames or in those of either kind.
 * Returns 0 for a field that no such frame has, and for those without an end of their own: flags,
 * their delimiters, CW_FIELD_STUFF and CW_FIELD_BIT. */
unsigned cw_field_bits(cw_field field, bool fd);

/* The place of a bit. A stuff bit has the field and index of the bit before it (F7). A fixed stuff
 * bit has a field of its own, and is a stuff bit, too. */
typedef struct cw_place {
    cw_field field;
    uint16_t index;
    bool stuff;
    bool extended; /* known to be in an extended frame: as transmitter from its SRR, otherwise after
                      IDE */
} cw_place;

/* ---- Wire bits of a frame -------------------------------------------------------------------- */

#define CW_BIT_WORDS (CW_BITS_MAX / 64)

/* A frame encoded once: SOF to EOF with stuff bits, ACK slot recessive as the transmitter sends it.
 * Bit 0 is SOF. Read through the functions below. */
typedef struct cw_bits {
    uint32_t crc;       /* the CRC that was sent (F6, D6) */
    uint16_t length;    /* wire bits */
    uint8_t bytes;      /* of the data field */
    uint8_t format;     /* CW_BITS_* */
    uint64_t level[CW_BIT_WORDS]; /* bit n of the wire is bit n % 64 of word n / 64; those up to
                                     the word of the last bit count */
} cw_bits;

#define CW_BITS_EXTENDED 0x01u
#define CW_BITS_FD 0x02u
#define CW_BITS_NON_ISO 0x04u /* without stuff count, and the CRC begins with 0 */

/* Encodes a frame (F1..F7, D1..D6). Returns CW_INVALID, leaving *bits alone, when
 * !cw_frame_valid(). */
cw_status cw_bits_encode(cw_bits *bits, const cw_frame *frame);

/* Bits in which a classical frame can deviate (F5). Stuff bits and CRC are right for what is
 * sent. */
#define CW_DEVIATES_SRR 0x1u /* SRR of an extended frame is dominant */
#define CW_DEVIATES_R1 0x2u  /* r1 of an extended frame is recessive; CAN FD has FDF there */
#define CW_DEVIATES_R0 0x4u  /* r0 is recessive; CAN FD has FDF there in a base frame */

/* Does the same with deviating bits, a set of CW_DEVIATES_*. CW_INVALID: the frame lacks one of
 * them, or is an FD frame. */
cw_status cw_bits_encode_deviant(cw_bits *bits, const cw_frame *frame, unsigned deviations);

/* Returns true for the bits between the sample points at which the rate changes (D10). These are
 * the bits after BRS and before the CRC delimiter, when BRS is recessive. BRS and CRC delimiter are
 * of mixed length. */
bool cw_bits_is_fast(const cw_bits *bits, unsigned n);

/* Returns the length alone, in a third of the time. It equals bits->length after cw_bits_encode():
 * SOF to EOF with stuff bits. Returns 0 when !cw_frame_valid(). */
unsigned cw_frame_wire_bits(const cw_frame *frame);

/* Returns the level of wire bit n, n < bits->length. */
bool cw_bits_level(const cw_bits *bits, unsigned n);

/* Returns field, index and stuff flag of wire bit n, n < bits->length. */
cw_place cw_bits_place(const cw_bits *bits, unsigned n);

/* Returns true when wire bit n stands at (field, index). CW_FIELD_STUFF and CW_FIELD_BIT count as
 * described at cw_field. A stuff bit stands at no other field; a fixed one has its own. */
bool cw_bits_is_at(const cw_bits *bits, unsigned n, cw_field field, unsigned index);

/* ---- Errors, states and modes ---------------------------------------------------------------- */

typedef enum cw_error_type {
    CW_ERROR_BIT = 0,
    CW_ERROR_STUFF,
    CW_ERROR_FORM,
    CW_ERROR_CRC,
    CW_ERROR_ACK,
    CW_ERROR_COUNT
} cw_error_type;

typedef enum cw_flag { CW_FLAG_NONE = 0, CW_FLAG_ACTIVE, CW_FLAG_PASSIVE } cw_flag;

/* A node's part in the present or last frame. It lasts through error and overload frames,
 * intermission and suspend (R3), until idle or the next SOF. */
typedef enum cw_role { CW_ROLE_NONE = 0, CW_ROLE_RECEIVER, CW_ROLE_TRANSMITTER } cw_role;

/* The states as Linux shows them, from the larger of TEC and REC (R9..R13), or since the node
 * sleeps. A controller alone is never SLEEPING, see cw_mac_sleep(). */
typedef enum cw_state {
    CW_STATE_ERROR_ACTIVE = 0,
    CW_STATE_ERROR_WARNING, /* at or above the warning limit; still error active on the wire */
    CW_STATE_ERROR_PASSIVE,
    CW_STATE_BUS_OFF,
    CW_STATE_SLEEPING, /* also while it wakes up */
    CW_STATE_COUNT
} cw_state;

typedef struct cw_error {
    cw_error_type type;
    cw_role role;   /* transmitter or receiver when it was detected */
    cw_place place; /* the bit in which it was detected, as this node counts */
    cw_flag flag;   /* the flag that follows; none when the node went bus-off by it */
    uint8_t sent;   /* BIT: 1 plus the level that the node sent; 0 of a bit compared late */
} cw_error;

/* Why a frame was dropped. The names are the "why" of drop events. */
typedef enum cw_drop {
    CW_DROP_QUEUE_FULL = 0,
    CW_DROP_ONE_SHOT,
    CW_DROP_BUS_OFF,
    CW_DROP_LISTEN_ONLY,
    CW_DROP_BAD_FRAME,
    CW_DROP_FAULT,
    CW_DROP_REMOVED, /* the node is no longer part of the bus */
    CW_DROP_LINK_DOWN, /* the host has taken the node off the bus */
    CW_DROP_SLOT_MISSED, /* L5: it has not begun in its slot */
    CW_DROP_COUNT
} cw_drop;

#define CW_MODE_ONE_SHOT 0x01u    /* M13: one attempt, then the frame is dropped */
#define CW_MODE_LISTEN_ONLY 0x02u /* M11: bus monitoring */
#define CW_MODE_LOOPBACK 0x04u    /* M15: samples only itself, receives its own frames */
#define CW_MODE_PRESUME_ACK 0x08u /* M14: a missing ACK is not an error */
#define CW_MODE_BERR_REPORTING 0x10u /* for the host: nothing changes on the wire */
#define CW_MODE_LOST_ARBITRATION_REPORTING 0x20u /* the same */
#define CW_MODE_RESTRICTED 0x40u /* D19: receives and acknowledges, and sends nothing else */
#define CW_MODE_TIME_TRIGGERED 0x80u /* L1: one attempt, and no error or overload flags */

const char *cw_error_type_name(cw_error_type type); /* "bit" "stuff" "form" "crc" "ack" */
const char *cw_flag_name(cw_flag flag);             /* "none" "active" "passive" */
const char *cw_state_name(cw_state state);          /* "error-active" .. "sleeping" */
const char *cw_drop_name(cw_drop why);              /* "queue-full" .. "slot-missed" */

/* ---- The controller: test-bench interface (stable) ------------------------------------------- */

/* One CAN controller without a bus. The bench is the rest of the bus: in every bit it calls
 *
 *     bool own = cw_mac_drive(&mac);               what the controller puts on the wire
 *     cw_mac_sample(&mac, level, &report);         what the wire carried, at the sample point
 *
 * in turn, exactly once each. Normally level = own AND the level that the bench drives, but any
 * level may be sampled. Offer a transmission with cw_mac_offer() before the cw_mac_drive() of the
 * bit in which it may start. An idle controller starts with the SOF. Right after a foreign SOF that
 * it may join (M6), a controller starts with the first identifier bit. Read frames, errors and
 * counters from the report and by the functions below. After cw_mac_init() the controller
 * integrates (M10): after eleven recessive bits it is idle. */

typedef enum cw_mac_phase {
    CW_MAC_OFF = 0,        /* disconnected: neither drives nor samples */
    CW_MAC_INTEGRATING,    /* waits for 11 recessive bits (M10) */
    CW_MAC_IDLE,
    CW_MAC_FRAME,          /* SOF to the end of EOF, as transmitter or receiver */
    CW_MAC_ERROR_ACTIVE,   /* sends an active error flag */
    CW_MAC_ERROR_PASSIVE,  /* sends a passive error flag (E7) */
    CW_MAC_ERROR_WAIT,     /* after its flag: recessive until the bus is (E8) */
    CW_MAC_ERROR_DELIMITER,
    CW_MAC_OVERLOAD_FLAG,
    CW_MAC_OVERLOAD_WAIT,
    CW_MAC_OVERLOAD_DELIMITER,
    CW_MAC_INTERMISSION,
    CW_MAC_SUSPEND,        /* M8 */
    CW_MAC_BUS_OFF,        /* R10; waits for the restart request */
    CW_MAC_RECOVERING,     /* R12; counts 128 groups of 11 recessive bits */
    CW_MAC_ASLEEP,         /* neither drives nor samples, see cw_mac_sleep() */
    CW_MAC_PHASE_COUNT
} cw_mac_phase;

/* Fault confinement: the counters and the state that follows from them (section 5 of RULES.md). */
typedef struct cw_confinement {
    uint16_t tec;
    uint16_t rec;
    uint16_t warning_limit;
    uint8_t state; /* cw_state; bus-off stays until the counters are reset */
    bool frozen : 1;    /* listen-only: the counters do not move (M11) */
    bool holds_rec : 1; /* CW_VARIANT_REC_HOLDS */
} cw_confinement;

/* The frames that a controller knows (D16, D17). */
typedef enum cw_protocol {
    CW_CLASSICAL = 0, /* FDF is a reserved bit: it destroys FD frames by error flags */
    CW_FD_TOLERANT,   /* classical, but FD frames are protocol exceptions (D16) */
    CW_FD,
} cw_protocol;

/* The part of a controller that knows FD frames, in memory of the caller. The fields are the
 * library's. */
typedef struct cw_fd_part {
    uint32_t crc17;      /* D6, over the bits sampled so far */
    uint32_t crc21;
    uint8_t stuff_bits;  /* dynamic ones, seen so far; modulo 256 */
    uint8_t inverted;    /* bits of the CRC of tx that a fault has inverted */
    bool acknowledged;   /* transmitter: the first bit of the ACK slot was dominant (D7) */
    bool fast;           /* the next bit is sampled at the data rate (D10) */
    bool compares_late;  /* the transmitter does not compare at its sample points (D13) */
    uint8_t late_error;  /* ... and has found an error since the last one: 1 + cw_error_type */
    cw_frame rx;         /* in place of the ones of cw_mac */
    cw_frame offer;      /* the frame of tx */
    cw_bits tx;
} cw_fd_part;

/* Room for the start of a cw_frame, up to 8 bytes of data, and of the cw_bits of a classical
 * frame. */
typedef struct cw_short_frame {
    uint32_t id;
    uint8_t flags;
    uint8_t dlc;
    uint8_t data[CW_CLASSICAL_DATA_MAX];
} cw_short_frame;

typedef struct cw_short_bits {
    uint32_t crc;
    uint16_t length;
    uint8_t bytes;
    uint8_t format;
    uint64_t level[3];
} cw_short_bits;

/* The fields are the library's; read through the functions. */
typedef struct cw_mac {
    uint8_t phase;            /* cw_mac_phase */
    uint8_t role;             /* cw_role */
    uint8_t modes;            /* CW_MODE_* */
    uint8_t reported_state;   /* cw_state of the last report */
    uint8_t part;             /* in CW_MAC_FRAME: part of the frame that the next bit belongs to */
    uint8_t before_part;      /* part and index of the last bit that was not a stuff bit (F7) */
    uint16_t index;           /* ... bit of that part; a stuff bit comes first when run is 5 */
    uint16_t before_index;
    uint16_t part_bits;       /* of the part */
    uint8_t count;            /* bits seen in the present flag, delimiter, intermission ... */
    uint8_t run;              /* equal bits in a row in the stuffed part, stuff bits counted */
    uint8_t groups;           /* R12, software reset: groups of 11 recessive bits seen */
    uint8_t overloads_wanted; /* O1 a, not yet sent */
    uint8_t overloads_in_row; /* O1 a, sent since the last frame or idle */
    uint8_t protocol;         /* cw_protocol, and CW_PROTOCOL_* */
    uint16_t tx_next;         /* transmitter: own wire bit that comes next */
    bool last;                /* level of the last stuffed or passive flag bit */
    bool driven;              /* own level in this bit, before a mode hides it from the bus */
    bool offered;             /* tx holds a frame that waits or is being sent */
    bool started;             /* own transmission begins with this bit */
    bool may_join;            /* a foreign SOF was just seen that this node may join (M1, M6) */
    bool crc_error : 1;       /* receiver: CRC wrong, not yet signalled (E3) */
    bool no_ack : 1;          /* a fault: it does not acknowledge */
    bool ack_deferred : 1;    /* R3 i: TEC moves when a dominant bit is seen in the flag */
    bool no_high_ids : 1;     /* CW_VARIANT_NO_HIGH_IDS */
    bool no_long_dlc : 1;     /* CW_VARIANT_NO_LONG_DLC */
    bool waits_long : 1;      /* software reset: it integrates by 128 groups of 11 recessive bits */
    bool tells_won : 1;       /* it reports an arbitration that it has won, for the bus */
    bool sleeps : 1;          /* it is asleep, or shall be as soon as it can */
    uint16_t crc;             /* F6, over the bits sampled so far */
    uint32_t shift;           /* bits of the present field, first one highest */
    cw_confinement confinement;
    cw_fd_part *fd;           /* NULL: it knows classical frames only */
    cw_short_frame rx;        /* frame being received, or last received */
    cw_short_bits tx;         /* wire bits of the offered frame */
} cw_mac;

/* The report of one bit: a set of CW_REPORT_* and the details. */
#define CW_REPORT_STARTED 0x01u          /* own transmission began with this bit */
#define CW_REPORT_ARBITRATION_LOST 0x02u /* lost_bit is valid (M2) */
#define CW_REPORT_ERROR 0x04u            /* error is valid */
#define CW_REPORT_OVERLOAD 0x08u         /* an own overload flag starts at the next bit (O1) */
#define CW_REPORT_RX 0x10u               /* a frame became valid for this receiver (M7) */
#define CW_REPORT_TX 0x20u               /* the own frame is done (M7); the offer is used up */
#define CW_REPORT_STATE 0x40u            /* the state changed; cw_mac_state() is the new one */
#define CW_REPORT_DROPPED 0x80u          /* the offered frame was given up; why is valid */
#define CW_REPORT_EXCEPTION 0x200u       /* protocol exception: the controller integrates (D16) */
#define CW_REPORT_TOLERATED 0x100u       /* a counter moved by R2, R6 or late by R3 i, without an
                                            error of its own; error.role and .place are valid */
#define CW_REPORT_SLEEP 0x1000u          /* the controller has fallen asleep */
#define CW_REPORT_WAKE 0x2000u           /* by the bus alone: the node has seen what wakes it */

typedef struct cw_mac_report {
    uint16_t what;
    uint8_t lost_bit; /* as the SJA1000 counts: 0 first id bit, 11 RTR/SRR, 12 IDE, 13.., 31 RTR */
    uint8_t why : 7;  /* a cw_drop: CW_DROP_ONE_SHOT (M13) or CW_DROP_BUS_OFF (R10) */
    uint8_t fast : 1; /* with CW_REPORT_ERROR: at the data rate (D10) */
    cw_error error;
} cw_mac_report;

/* Starts a controller: integrating, TEC = REC = 0. warning_limit 1..255, usually 96 (R13). */
void cw_mac_init(cw_mac *mac, unsigned modes, unsigned warning_limit);

/* Chooses the frames that a controller knows: a cw_protocol, and CW_PROTOCOL_*. It is CW_CLASSICAL
 * after cw_mac_init(). For CW_FD there must be a part for FD, which stays the caller's as long as
 * the controller is used; NULL for the others. A controller on the bus leaves it and integrates
 * again (M10). An offer is withdrawn. CW_INVALID: part and protocol do not fit. */
#define CW_PROTOCOL_MASK 0x0Fu         /* of the cw_protocol */
#define CW_PROTOCOL_NO_EXCEPTION 0x10u /* a protocol exception is a form error instead (D16) */
#define CW_PROTOCOL_NON_ISO 0x20u      /* see CW_FRAME_NON_ISO */
/* Controllers before CAN 2.0B, which are CW_CLASSICAL. One of 2.0A reads each frame as a base
 * frame: SRR as RTR, IDE as r1, id[11] as r0, id[12..15] as DLC. A passive one of 2.0B checks and
 * acknowledges extended frames, and its host gets none. Neither sends them. */
#define CW_PROTOCOL_2_0A 0x40u
#define CW_PROTOCOL_2_0B_PASSIVE 0x80u
cw_status cw_mac_set_protocol(cw_mac *mac, unsigned protocol, cw_fd_part *fd);

/* Chooses in which ways the controller differs from RULES.md: CW_VARIANT_*, none after
 * cw_mac_init(). Real ones do. An offer is withdrawn. CW_INVALID: other bits. */
#define CW_VARIANT_NO_HIGH_IDS 0x01u /* sends no identifier whose first seven bits are all
                                        recessive (2032 to 2047), against F8; receives them */
#define CW_VARIANT_NO_LONG_DLC 0x02u /* sends no classical frame with a DLC above 8, and takes such
                                        a DLC for a form error in its last bit, against F4 */
#define CW_VARIANT_REC_HOLDS 0x04u   /* REC does not go up from 128 on (R8) */
#define CW_VARIANT_SILENT_PASSIVE 0x08u /* of nodes of a bus: the host is told error-warning in
                                           place of error-passive. Nothing changes on the wire */
cw_status cw_mac_set_variants(cw_mac *mac, unsigned variants);

/* Returns true when a controller with these variants does not send the frame. */
bool cw_frame_is_refused(const cw_frame *frame, unsigned variants);

/* Offers a frame for transmission. The offer stays through lost arbitration, errors, disconnection
 * and changes of modes. It ends with exactly one report, CW_REPORT_TX or CW_REPORT_DROPPED, unless
 * it is withdrawn or replaced first. An offer that is not on the wire can be withdrawn or replaced.
 * Bus-off drops the offer. CW_INVALID: bad frame. CW_REFUSED: the frame is being sent, or the
 * controller is listen-only or bus-off. */
cw_status cw_mac_offer(cw_mac *mac, const cw_frame *frame);

/* Takes the offer back. CW_REFUSED when it is being sent just now. */
cw_status cw_mac_withdraw(cw_mac *mac);

/* Begins a bit. Returns the level that the controller puts onto the wire. */
bool cw_mac_drive(cw_mac *mac);

/* Ends the bit with the level of the wire and overwrites *report. */
void cw_mac_sample(cw_mac *mac, bool level, cw_mac_report *report);

#define CW_OVERLOADS_MAX 2u /* that delay one frame (O1 a) */

/* Asks for overload frames, sent from the next expected intermission on (O1 a). CW_INVALID when the
 * number is not 1..CW_OVERLOADS_MAX. */
cw_status cw_mac_request_overload(cw_mac *mac, unsigned frames);

/* Asks to leave bus-off (R12). CW_REFUSED when the controller is not bus-off or already counting.*/
cw_status cw_mac_request_restart(cw_mac *mac);

#define CW_TEC_MAX 263u /* the highest value that bus-off can leave (R10) */
#define CW_REC_MAX 255u /* R8, ruling: an 8-bit counter */

/* Presets the counters: TEC 0..CW_TEC_MAX, REC 0..CW_REC_MAX. A TEC above 255 is bus-off (R10), a
 * TEC below 256 ends a bus-off. CW_INVALID: out of range. The next report has a changed state, and
 * the drop of an offer that follows from it. */
cw_status cw_mac_set_counters(cw_mac *mac, unsigned tec, unsigned rec);

/* Resets the controller: it stops whatever it does at once. The offer and overload frames that are
 * wanted are forgotten, TEC = REC = 0. Modes, limits and protocol stay. After a hardware reset the
 * controller integrates (M10), also out of bus-off. After a software reset it comes back when it
 * has seen 128 groups of 11 recessive bits, counted as in R12. In bus-off a software reset is a
 * restart (R12): state and counters change after the last group. A controller that is disconnected
 * stays so, and does this when it is back. */
void cw_mac_reset(cw_mac *mac, bool hardware);

/* Changes the modes. When listen-only, loopback or restricted changes, a controller on the bus
 * leaves it and integrates again (M10). */
void cw_mac_set_modes(cw_mac *mac, unsigned modes);

/* Takes the controller off the bus at once, as if its line was cut: it neither drives nor samples,
 * and counts nothing. A frame that it was sending stays offered and is sent anew after
 * cw_mac_reconnect(). Nothing happens to a controller in bus-off: it stays so, and continues its
 * recovery. A controller that cw_mac_set_counters() meanwhile puts into bus-off, or takes out of
 * it, is no longer disconnected. */
void cw_mac_disconnect(cw_mac *mac);

/* Puts the controller back on the bus after cw_mac_disconnect(): it integrates (M10). Otherwise
 * nothing happens. */
void cw_mac_reconnect(cw_mac *mac);

/* Lets the controller sleep: it neither drives nor samples until cw_mac_wake(), and keeps offer and
 * counters. It falls asleep at once when it is idle, integrates, or is disconnected. Otherwise it
 * first finishes what is on the bus, and the report of the bit before it would be idle has
 * CW_REPORT_SLEEP. In bus-off it sleeps after the recovery. */
void cw_mac_sleep(cw_mac *mac);

/* Wakes the controller: it integrates (M10). One that was still to fall asleep stays awake. */
void cw_mac_wake(cw_mac *mac);

/* A sleeping node is woken by its transceiver, which filters short dominant phases (ISO 11898-2).
 * Set `length` to the filter time, in any unit, and `dominant` to 0. */
typedef struct cw_wake_filter {
    uint64_t length;
    uint64_t dominant; /* of the present dominant phase, so far */
} cw_wake_filter;

/* Takes a level that lasts for a time, 1 or more. Returns true when the wire has been dominant for
 * `length` without a break. */
bool cw_wake_filter_take(cw_wake_filter *filter, bool level, uint64_t time);

/* Returns true when the next cw_mac_drive() would use an offer made now. */
bool cw_mac_can_start(const cw_mac *mac);

/* Returns true while the own frame is on the wire: the controller is transmitter, SOF to EOF. */
bool cw_mac_is_sending(const cw_mac *mac);

unsigned cw_mac_tec(const cw_mac *mac);
unsigned cw_mac_rec(const cw_mac *mac);
cw_state cw_mac_state(const cw_mac *mac);
cw_mac_phase cw_mac_get_phase(const cw_mac *mac);
cw_role cw_mac_role(const cw_mac *mac);

/* Returns the place of the next bit to be sampled, as this controller counts; CW_FIELD_NONE when
 * idle, integrating or off. Between cw_mac_drive() and cw_mac_sample() that is the bit in
 * progress. */
cw_place cw_mac_place(const cw_mac *mac);

/* Returns the frame last received, valid from CW_REPORT_RX until the next SOF. */
const cw_frame *cw_mac_received(const cw_mac *mac);

/* ---- The controller in time: timed test-bench interface (stable) ----------------------------- */

/* Transmitter delay compensation (D13), with the names of `ip link`. Values are in clocks. */
typedef enum cw_tdc_mode {
    CW_TDC_OFF = 0, /* a transmitter compares its bits at its sample point */
    CW_TDC_AUTO,    /* ... tdcv is the delay of the edge to res, as measured in each frame */
    CW_TDC_MANUAL,  /* ... tdcv is given */
} cw_tdc_mode;

#define CW_TDC_BITS_MAX 32u /* of the data phase: tdcv + tdco is less */

typedef struct cw_tdc {
    cw_tdc_mode mode;
    uint32_t tdco; /* from the start of a bit to the secondary sample point, without delay */
    uint32_t tdcv; /* MANUAL: the delay */
} cw_tdc;

/* The data phase of FD frames (D10). All 0: it has the bit timing of the rest of the frame. Both
 * quanta are whole clocks of the controller, so one follows from the other. */
typedef struct cw_data_timing {
    cw_bit_timing bit; /* its quantum is not read: it is data_brp / brp of the other one */
    uint32_t brp;      /* clocks of a quantum of the arbitration phase, 1..65536 */
    uint32_t data_brp; /* ... of the data phase; 0: no other rate */
    cw_tdc tdc;
} cw_data_timing;

/* Bits that a transmitter has sent in the data phase and compares later. The fields are the
 * library's. */
typedef struct cw_late_compare {
    cw_tdc tdc;
    int64_t clock;       /* units of a clock */
    int64_t measured_to; /* end of the last clock that has been looked at, from the start of the own
                            res bit on */
    int64_t begun_at[2 * CW_TDC_BITS_MAX]; /* starts of the last bits, in a ring: the n-th after BRS
                                              is at n modulo the size */
    uint64_t sent;       /* their levels, the newest lowest */
    uint64_t fixed;      /* those that are fixed stuff bits, likewise */
    uint32_t passed;     /* clocks that have been looked at */
    uint32_t delay;      /* clocks: tdcv as measured, or given */
    uint32_t begun;      /* bits after BRS */
    uint32_t compared;   /* ... of them */
    bool measures;       /* waits for the own edge to res */
} cw_late_compare;

/* One CAN controller with its physical coding sublayer and its clock, without a bus. The bench is
 * the rest of the bus, and steps the controller by the time quantum:
 *
 *     bool own = cw_timed_mac_level(&c);                   what it drives in this quantum
 *     unsigned what = cw_timed_mac_quantum(&c, level, &report);
 *
 * or by the clock with cw_timed_mac_clock(), brp times for a quantum. `level` is what the
 * controller sees at the end of the quantum. Normally that is the AND of what it drives and what
 * the bench drives, each as late as the bench likes. Rules T3 to T7 and T12 of RULES.md say what
 * follows.
 * Offer frames to `mac` at any time; one that is offered before a bit begins may be sent from that
 * bit on. After cw_timed_mac_init() a bit begins, and the controller integrates (M10). */
typedef struct cw_timed_mac {
    cw_mac mac;           /* for cw_mac_offer() and the functions that read */
    cw_bit_timing timing;
    cw_pcs pcs;
    cw_bit_timing data_timing; /* of the data phase, see cw_timed_mac_set_data() */
    uint32_t brp;
    uint32_t data_brp;
    uint32_t clocks;      /* of the quantum in progress */
    uint16_t count;       /* quanta of the bit that have passed */
    bool driven;
    bool fast;            /* the bit goes by data_timing */
    bool seen[3];         /* levels at the ends of the last quanta, the newest first */
    int64_t now;          /* clocks so far */
    cw_late_compare late;
} cw_timed_mac;

#define CW_QUANTUM_SAMPLED 0x1u  /* it was the last before the sample point: the report is valid */
#define CW_QUANTUM_BIT_ENDED 0x2u /* a bit begins now: cw_timed_mac_level() may be another one */
#define CW_QUANTUM_HARD_SYNC 0x4u /* an edge in this quantum was hard synchronised (T4) */
#define CW_QUANTUM_RESYNC 0x8u    /* an edge in this quantum was resynchronised (T5) */

/* Gives a controller that knows FD frames (cw_mac_set_protocol()) the bit timing of the data phase.
 * Without it both phases have the same. tdc: NULL is CW_TDC_OFF. Call it before the first bit, and
 * again after cw_mac_set_protocol(). CW_INVALID: !cw_bit_timing_valid(), brp is 0, or a value of
 * tdc is out of range. CW_REFUSED: the controller knows no FD frames. */
cw_status cw_timed_mac_set_data(cw_timed_mac *c, const cw_bit_timing *timing, uint32_t brp,
                                const cw_tdc *tdc);

/* Returns true when the quantum that begins now is one of the data phase (D10). */
bool cw_timed_mac_is_fast(const cw_timed_mac *c);

/* Starts a controller. timing->quantum only matters to the caller. brp: clocks of a quantum, at
 * least 1. modes and warning_limit: see cw_mac_init(). CW_INVALID: !cw_bit_timing_valid(), or
 * brp is 0. */
cw_status cw_timed_mac_init(cw_timed_mac *c, const cw_bit_timing *timing, uint32_t brp,
                            unsigned modes, unsigned warning_limit);

/* Returns the level that the controller puts onto the wire in the quantum that begins now. */
bool cw_timed_mac_level(const cw_timed_mac *c);

/* Ends a quantum with the level that the controller sees. Returns a set of CW_QUANTUM_*. Writes
 * *report when the bit is sampled, and leaves it alone otherwise. */
unsigned cw_timed_mac_quantum(cw_timed_mac *c, bool level, cw_mac_report *report);

/* Does the same by one clock: only the last of the brp clocks of a quantum ends it, with that
 * level. Returns 0 for the others. */
unsigned cw_timed_mac_clock(cw_timed_mac *c, bool level, cw_mac_report *report);

/* Returns the quanta of the bit in progress that have passed, 0 at its start. */
unsigned cw_timed_mac_quanta(const cw_timed_mac *c);

/* ---- Fault rules ----------------------------------------------------------------------------- */

/* SocketCAN's filter: matches when (id & mask) == (value & mask), on the identifier with
 * CW_FILTER_EXTENDED and CW_FILTER_REMOTE added as the kernel's can_id has them. */
#define CW_FILTER_EXTENDED 0x80000000u
#define CW_FILTER_REMOTE 0x40000000u

/* Masks that let one identifier through, of base or of extended frames, data and remote. */
#define CW_FILTER_BASE_MASK (CW_FILTER_EXTENDED | CW_BASE_ID_MAX)
#define CW_FILTER_EXTENDED_MASK (CW_FILTER_EXTENDED | CW_EXTENDED_ID_MAX)

/* Returns what filters look at: the identifier with these bits, the kernel's can_id. */
uint32_t cw_frame_can_id(const cw_frame *frame);

typedef struct cw_filter {
    uint32_t value;
    uint32_t mask;
    bool inverted;
} cw_filter;

/* Returns true when one of the filters matches the frame. Without filters every frame matches. */
bool cw_frame_matches(const cw_frame *frame, const cw_filter *filters, unsigned count);

/* The trigger of a rule. With `has_after` or `manual` the rule must also be armed: each hit of rule
 * `after` (after_delay later) and each cw_bus_fire_rule() arms it for one hit. */
typedef enum cw_trigger {
    CW_TRIGGER_FRAME = 0, /* frames that match; see cw_action for the moment */
    CW_TRIGGER_TIME,      /* the first bit that starts at or after time_begin, and then after each
                             again_ticks before time_end */
    CW_TRIGGER_ARMED,     /* arming alone: the rule acts when it is armed */
    CW_TRIGGER_ERROR,     /* errors of `from` whose class is in error_mask */
} cw_trigger;

/* The action of a rule. With a frame trigger, bit actions act when their position is reached, and
 * host actions when a node is handed the frame or gets it. REPLY acts when `node` receives the
 * frame. All others act when a transmission of the frame begins. */
typedef enum cw_action {
    /* Levels. FLIP, FORCE and GLITCH have a position and so need a frame trigger. The others last
     * for for_ticks. 0 means until the rule is cleared; but NOISE and NO_ACK with a frame trigger
     * then last for that transmission: */
    CW_ACTION_FLIP = 0,   /* inverts `bits` wire bits from (field, index) on */
    CW_ACTION_FORCE,      /* sets them to `level`; for_ticks, when set, instead of bits */
    CW_ACTION_GLITCH,     /* pattern of `bits` bits from there on */
    CW_ACTION_STUCK,      /* `level` on `line` of the wire or of `node` */
    CW_ACTION_NOISE,      /* flips each bit with error_rate, or begins a burst of such bits,
                             independently for each node of `at` */
    CW_ACTION_NO_ACK,     /* nodes of `nodes` do not acknowledge */
    CW_ACTION_PULSE,      /* `level` for pulse_length, pulse_offset after the start of the bit at
                             (field, index), on `line` of the wire or of `node`; with `at`, only
                             what these nodes see. Without a frame trigger the bit is the next
                             bit time of the bus */
    CW_ACTION_JITTER,     /* edges of `nodes` come up to jitter late, each one another time */
    CW_ACTION_RAMP,       /* the time quantum of `nodes` goes from quantum_from to quantum_to in
                             for_ticks, and stays there */
    CW_ACTION_RAW,        /* `node` drives the first `bits` of `raw` from the next bit on, or, with
                             raw_when_idle, when its controller or the wire is idle. Its
                             controller is off the bus meanwhile, so it samples nothing; then it
                             integrates (M10) */
    CW_ACTION_DISCONNECT, /* nodes of `nodes` neither drive nor sample */
    CW_ACTION_PARTITION,  /* group[] gives each node's wire */
    /* Once, to the controllers of `nodes`: */
    CW_ACTION_WRONG_CRC,  /* the frame that begins carries an inverted last CRC bit */
    CW_ACTION_BUS_OFF,
    CW_ACTION_ERROR_FLAG, /* as if it had detected an error, whatever it is doing */
    CW_ACTION_RESTART,    /* as cw_node_restart() */
    CW_ACTION_COUNTERS,   /* tec, rec; CW_KEEP leaves one alone */
    CW_ACTION_OVERLOAD,   /* asks for `number` overload frames */
    CW_ACTION_SET,        /* `settings` */
    CW_ACTION_SOFTWARE_RESET, /* see cw_mac_reset(); frames that wait are dropped, and so are frames
                                 that wait for the host */
    CW_ACTION_HARDWARE_RESET,
    /* On the host side of the matching frame. With CW_SIDE_TX they act where a node of `from` is
     * handed the frame, with CW_SIDE_RX where a node of `at` (0: any) gets it: */
    CW_ACTION_DROP,
    CW_ACTION_DELAY,     /* by for_ticks */
    CW_ACTION_DUPLICATE, /* `number` more copies */
    CW_ACTION_REORDER,   /* after the next `number` frames of that node and side */
    CW_ACTION_CHANGE,    /* `change` */
    /* On frames as their senders make them, before all other rules; only frames of a cw_protection
     * that has what they act on match. The last one of several counts. CW_SIDE_TX: */
    CW_ACTION_COUNTER,   /* a cw_counter_fault in `number` */
    CW_ACTION_CHECKSUM,  /* all bits of the checksum are inverted */
    /* Traffic of `node`: */
    CW_ACTION_SEND,   /* `frame`, at once and then every period_ticks (0: once) while it lasts */
    CW_ACTION_BABBLE, /* `frame`, again as soon as the last one is done, while it lasts */
    CW_ACTION_LOAD,   /* random frames up to load_permille of the bus, while it lasts */
    CW_ACTION_REPLY,  /* `frame` answers the matching one, after for_ticks */
    CW_ACTION_RAW_FRAME, /* `frame` once, each attempt with `deviations` */
    CW_ACTION_COUNT
} cw_action;

/* The kinds of actions, by the object that they act on. */
typedef enum cw_action_kind {
    CW_KIND_POSITION = 0, /* bits of a frame, from a position on */
    CW_KIND_LEVEL,        /* levels, wires or acknowledging, for a time */
    CW_KIND_CONTROL,      /* controllers, once */
    CW_KIND_HOST,         /* frames between a host and its controller */
    CW_KIND_TRAFFIC,      /* frames that a node sends */
} cw_action_kind;

/* Returns the name used in configurations: "flip", "no-ack". */
const char *cw_action_name(cw_action action);
cw_action_kind cw_action_kind_of(cw_action action);

/* Returns true when only rules with CW_TRIGGER_FRAME can have that action. */
bool cw_action_needs_frame(cw_action action);

typedef enum cw_line { CW_LINE_WIRE = 0, CW_LINE_TX, CW_LINE_RX } cw_line;
typedef enum cw_side { CW_SIDE_TX = 0, CW_SIDE_RX } cw_side;

/* Faults of the counter in a frame. The first frame has no value before it, and gets its own. */
typedef enum cw_counter_fault {
    CW_COUNTER_STUCK = 0, /* it has the value of the frame before; the counter stands still */
    CW_COUNTER_SKIP,      /* a value is left out before it */
    CW_COUNTER_REPEAT,    /* it has the value of the frame before; the counter goes on meanwhile */
    CW_COUNTER_FAULTS
} cw_counter_fault;

#define CW_KEEP UINT16_MAX
#define CW_PATTERN_MAX 64 /* bits of a glitch */
#define CW_BURST_MAX 16   /* bits of a burst of noise */
#define CW_COPIES_MAX 16u /* copies that a rule can make of one frame */
#define CW_RAW_MAX 192    /* bits of RAW, more than a classical frame has */

/* Changes of a node's settings; fields whose CW_SET_* is not in `which` are ignored. */
#define CW_SET_MODES 0x01u /* the modes of modes_mask become those in modes */
#define CW_SET_RESTART 0x02u
#define CW_SET_QUEUE 0x04u /* frames beyond a smaller limit stay, new ones are dropped */
#define CW_SET_ORDER 0x08u
#define CW_SET_WARNING 0x10u
#define CW_SET_QUANTUM 0x20u  /* parts of the bit timing, from the node's next bit on */
#define CW_SET_SEGMENTS 0x40u /* ... with sjw */
#define CW_SET_SAMPLING 0x80u /* ... triple_sampling */
#define CW_SET_TIMING (CW_SET_QUANTUM | CW_SET_SEGMENTS | CW_SET_SAMPLING)
#define CW_SET_TX_DELAY 0x100u /* ways of edges, see cw_node_timing: of those that come from then */
#define CW_SET_RX_DELAY 0x200u /* ... on. One that is under way arrives as it would have. After */
#define CW_SET_PLACE 0x400u    /* ... 16 changes for edges under way the next one is refused */
#define CW_SET_STUB 0x800u
#define CW_SET_WAY (CW_SET_TX_DELAY | CW_SET_RX_DELAY | CW_SET_PLACE | CW_SET_STUB)
#define CW_SET_RINGING 0x1000u /* after edges that come from then on; what swings now ends */
#define CW_SET_UNIT 0x40000u   /* with CW_SET_QUANTUM: as many clocks as before make the quantum of
                                  the node, and `unit` is that of its local time (L2) */
#define CW_SET_DATA 0x2000u    /* the data phase of FD frames, from the node's next bit on. Without
                                  it CW_SET_QUANTUM is another clock, and changes both rates */
#define CW_SET_SLEEP 0x4000u   /* it falls asleep as cw_mac_sleep() does, or is woken by its host */
#define CW_SET_WAKE_FILTER 0x8000u
#define CW_SET_WAKE_TIME 0x10000u
#define CW_SET_WAKE_ON 0x20000u
#define CW_SET_WAKE (CW_SET_WAKE_FILTER | CW_SET_WAKE_TIME | CW_SET_WAKE_ON)
#define CW_SET_CLOCKS (CW_SET_TIMING | CW_SET_WAY | CW_SET_RINGING | CW_SET_DATA)

typedef enum cw_order { CW_ORDER_PRIORITY = 0, CW_ORDER_FIFO } cw_order;

/* The sleep of a node. It keeps its counters and its queue, and neither sends nor acknowledges. A
 * dominant phase of filter_ticks wakes it. With `frames` only a valid frame that one of them
 * matches does: the node listens like a listen-only one, which nobody sees. It integrates (M10)
 * wake_ticks after it has been woken. Frames wait in its queue meanwhile. */
typedef struct cw_sleep_settings {
    uint64_t filter_ticks; /* 0..CW_WAKE_TICKS_MAX; 0: any dominant bit or quantum */
    uint64_t wake_ticks;   /* 0..CW_WAKE_TICKS_MAX */
    uint8_t frame_count;
    cw_filter frames[CW_WAKE_FILTERS_MAX];
} cw_sleep_settings;

#define CW_WAKE_TICKS_MAX CW_CLOCK_HZ /* a second */

typedef struct cw_settings {
    uint32_t which;
    uint8_t modes_mask;
    uint8_t modes;
    cw_order order;
    uint16_t queue;
    uint16_t warning_limit;
    uint64_t restart_ticks;
    cw_bit_timing timing;
    cw_span tx_delay[2];
    cw_span rx_delay[2];
    cw_span place;
    cw_span stub;
    cw_span ringing; /* at most 16 of the shortest bits */
    cw_span unit;
    cw_data_timing data;
    bool sleeps; /* SLEEP */
    cw_sleep_settings sleep; /* WAKE */
} cw_settings;

/* A change of a frame's content. The CRC is right for the changed frame. `set` applies first, then
 * `and`, `or` and `xor`, to the data bytes. Length and identifier become the given ones. */
typedef struct cw_change {
    bool set_id;
    bool set_dlc;
    uint32_t id;
    uint8_t id_flags; /* CW_FRAME_EXTENDED or 0 */
    uint8_t dlc;
    uint8_t set_mask[CW_FRAME_DATA_MAX]; /* bits taken from set */
    uint8_t set[CW_FRAME_DATA_MAX];
    uint8_t and_mask[CW_FRAME_DATA_MAX]; /* all ones: no change */
    uint8_t or_mask[CW_FRAME_DATA_MAX];
    uint8_t xor_mask[CW_FRAME_DATA_MAX];
} cw_change;

/* The rates that a rule is for. */
typedef enum cw_phase_rate {
    CW_RATE_ANY = 0,
    CW_RATE_NOMINAL, /* all frames but FD frames with BRS; errors out of the data phase */
    CW_RATE_DATA,    /* FD frames with BRS; errors from the sample point of BRS to the one of the
                        CRC delimiter */
} cw_phase_rate;

typedef struct cw_rule {
    const char *name; /* distinct; with the seed it gives the rule's random stream; not kept */

    /* when */
    cw_trigger trigger;
    cw_filter filters[CW_RULE_FILTERS_MAX]; /* a frame matches when one of them does */
    uint8_t filter_count;                   /* 0: every frame matches */
    uint32_t error_mask;                    /* CW_TRIGGER_ERROR: classes of linux/can/error.h */
    uint8_t data_length;                    /* data bytes compared; shorter frames do not match */
    uint8_t data_mask[CW_FRAME_DATA_MAX];
    uint8_t data_value[CW_FRAME_DATA_MAX];
    cw_phase_rate rate;    /* FRAME: of its data field. ERROR: at which the error is found */
    uint64_t from;         /* transmitters; 0: every node */
    uint64_t state_nodes;  /* all of these are in a state of state_mask (1u << cw_state) */
    uint8_t state_mask;
    uint64_t time_begin;   /* ticks, half open: begin <= start of bit < end */
    uint64_t time_end;     /* CW_NEVER: no end */
    uint64_t again_ticks;  /* CW_TRIGGER_TIME: from one time to the next; 0: there is one */
    bool has_after;
    bool manual;
    uint16_t after;        /* index of a rule */
    uint64_t after_delay;  /* ticks */
    uint32_t skip;         /* matches passed over first */
    uint32_t every;        /* then the next and every every-th one; 0 is 1 */
    uint32_t count;        /* hits until the rule ends; 0: no end */
    uint64_t probability;  /* of 2^64, drawn per match; UINT64_MAX: always */
    uint64_t hold_off;     /* ticks after a hit in which matches are passed over */
    bool quiet;            /* traffic of a node, not a fault: hits are neither reported nor
                              counted */

    /* do */
    cw_action action;
    cw_field field; /* position, in the transmitter's own bits */
    uint16_t index;
    uint16_t bits;  /* wire bits from there on, at least 1 */
    uint64_t for_ticks;
    uint64_t at;    /* nodes whose samples change; 0: the wire, so all samples */
    uint64_t nodes; /* the nodes of a controller action */
    uint8_t node;   /* the node of the traffic, or of the line */
    bool level;
    cw_line line;
    cw_side side;
    uint64_t dominant_timeout; /* STUCK on a TX: ticks until the transceiver lets go; 0: never */
    uint64_t pattern_level;    /* GLITCH: bit i is the level of the i-th bit ... */
    uint64_t pattern_mask;     /* ... where this is set */
    uint64_t error_rate;       /* NOISE: of 2^64 */
    uint16_t burst_least;      /* NOISE: a burst of bits begins with error_rate. Its first and last
                                  bits are inverted, those between at random ... */
    uint16_t burst_most;       /* ... and its length is drawn from this range, 1..CW_BURST_MAX. 0, 0
                                  is one bit */
    cw_span pulse_offset;      /* PULSE: at most 16 bits of the bus, and pulse_permille of the bit
                                  are added to it */
    uint16_t pulse_permille;
    cw_span pulse_length;      /* more than 0 */
    cw_span jitter;            /* JITTER: more than 0, up to a bit of the bus */
    cw_span quantum_from;      /* RAMP: see cw_bit_timing */
    cw_span quantum_to;
    uint16_t tec;
    uint16_t rec;
    uint32_t number;
    uint16_t load_permille;
    uint8_t deviations;        /* RAW_FRAME: CW_DEVIATES_* */
    bool raw_when_idle;        /* RAW */
    uint64_t raw[CW_RAW_MAX / 64]; /* RAW: bit n is the level of bit n % 64 of word n / 64 */
    uint64_t period_ticks;
    uint8_t group[CW_NODES_MAX]; /* PARTITION */
    cw_settings settings;
    cw_change change;
    cw_frame frame;
} cw_rule;

/* ---- The bus --------------------------------------------------------------------------------- */

typedef struct cw_bus cw_bus; /* lives in memory of the caller, see cw_bus_size() */

/* The clock and the place of a node (T1, T2). All 0: those of the bus, so that all bits are common
 * to all nodes. A bit of a node may last between 1/64 and 64 bits of the bus, which last at most
 * 1.6 s. No edge may be under way for longer than 16 of the shortest bits. */
typedef struct cw_node_timing {
    cw_bit_timing bit;   /* quantum 0: a bit of the bus in 16 quanta, sampled after 14, SJW 1 */
    cw_span tx_delay[2]; /* from the controller to its wire, of edges to [CW_DOMINANT] and to
                            [CW_RECESSIVE] */
    cw_span rx_delay[2]; /* from the wire to the controller */
    cw_span place;       /* the way along the line to the node, from one end */
    cw_span stub;        /* the way from the line to the node */
    cw_span ringing;     /* the wire swings for that long after each edge to recessive: the node
                            sees it recessive for the first half, then dominant */
    cw_data_timing data; /* of nodes that know FD frames */
} cw_node_timing;

#define CW_DELAY_MAX (CW_TICK * 800000) /* 10 ms: of each delay and way */

#define CW_NODE_FILTERS_MAX 512u /* as of a CAN_RAW socket of Linux */
#define CW_RECEIVE_BUFFERS_MAX 64u
#define CW_MAILBOXES_MAX 64u

typedef enum cw_mailbox_use {
    CW_MAILBOX_RECEIVE = 0, /* keeps a received frame until the host has fetched it; a newer one
                               takes its place */
    CW_MAILBOX_TRANSMIT,    /* keeps a frame until it has been sent */
    CW_MAILBOX_REPLY,       /* keeps the last data frame that the host wrote, and sends it when a
                               remote frame of its identifier comes */
    CW_MAILBOX_USES
} cw_mailbox_use;

typedef struct cw_mailbox {
    cw_mailbox_use use;
    cw_filter filter; /* the frames that it takes; of REPLY one identifier */
    bool filled;      /* REPLY: it has `frame` from the start, a data frame that it takes */
    cw_frame frame;
} cw_mailbox;

/* The mailbox that goes next, of those with a frame. */
typedef enum cw_transmit {
    CW_TRANSMIT_PRIORITY = 0, /* the one with the most urgent identifier */
    CW_TRANSMIT_NUMBER,       /* the first one */
    CW_TRANSMIT_REQUEST,      /* the one that was filled first */
    CW_TRANSMIT_COUNT
} cw_transmit;

/* The part of a controller that its host sees. All 0: the host gets every frame, at once. */
typedef struct cw_host_config {
    const cw_filter *filters;  /* the frames that the host gets, when there are any; copied. They do
                                  not decide what the node acknowledges (M12) */
    uint16_t filter_count;     /* at most CW_NODE_FILTERS_MAX */
    uint16_t receive_buffers;  /* frames that wait for the host, the one that it is about to fetch
                                  included, 0..CW_RECEIVE_BUFFERS_MAX; 0: it takes each at once. A
                                  frame that finds them full is lost */
    uint64_t service_ticks;    /* time in which the host fetches a frame, one after the other */
    uint16_t receive_bytes;    /* 0, or the bytes that those frames may have together, as in the
                                  SJA1000: 3 with a base identifier, 5 with an extended one, and
                                  the data */
    bool overload_when_full;   /* the controller sends overload frames while its buffers are full
                                  after a frame, two at most (O1 a) */
    const cw_mailbox *mailboxes; /* numbered from 0; copied. The host gets the frames that the
                                    RECEIVE ones take. A frame that no TRANSMIT one takes is bad,
                                    and one that finds them full waits in the queue */
    uint8_t mailbox_count;     /* at most CW_MAILBOXES_MAX; 0: no mailboxes */
    bool receive_fifo;         /* the mailboxes are for sending; received frames go into the
                                  receive_buffers, which do not count otherwise */
    cw_transmit transmit;
} cw_host_config;

/* ---- Time-triggered operation (section 9 of RULES.md) ---------------------------------------- */

#define CW_LOCAL_BITS_MIN 16u
#define CW_LOCAL_BITS_MAX 32u
#define CW_LOCAL_UNIT_MAX (CW_TICK * CW_CLOCK_HZ) /* 1 s */
#define CW_TRIGGERS_MAX 255u /* of one node */
#define CW_CYCLES_MAX 64u    /* basic cycles of a matrix, as in ISO 11898-4 */

/* The local time of a node: a counter that its clock drives (L2). */
typedef struct cw_local_time {
    cw_span unit;   /* of the counter, CW_TICK..CW_LOCAL_UNIT_MAX, by the clock of the node */
    uint8_t bits;   /* CW_LOCAL_BITS_MIN..CW_LOCAL_BITS_MAX; 0: the node has no local time */
    bool at_eof;    /* L3: captured in the last bit of EOF, otherwise in SOF */
    uint32_t start; /* of the counter, at tick 0 */
} cw_local_time;

/* A slot of a node's schedule. Times are units of its local time. */
typedef struct cw_time_trigger {
    uint32_t at;      /* after the capture of the reference message */
    uint32_t slot;    /* the frame begins before that many units have passed, at least 1 */
    uint16_t repeat;  /* acts in basic cycles with number % repeat == cycle; 0: in all of them */
    uint16_t cycle;
    cw_frame frame;
} cw_time_trigger;

/* The schedule of a node (L4, L5). A trigger whose frame is a reference message makes the node the
 * time master. It acts in each basic cycle, and is the last one of it. */
typedef struct cw_schedule {
    cw_filter reference;   /* frames that begin a basic cycle */
    uint8_t cycles;        /* basic cycles of the matrix, 1..CW_CYCLES_MAX; 0: no schedule */
    uint8_t cycle_byte;    /* data byte of reference messages that has the number of the cycle;
                              beyond their data: nodes count */
    uint16_t trigger_count;          /* at most CW_TRIGGERS_MAX */
    const cw_time_trigger *triggers; /* in the order of `at`; copied */
} cw_schedule;

/* Counts of one trigger. */
typedef struct cw_trigger_stats {
    uint64_t slots;      /* in which it has handed its frame in */
    uint64_t started;    /* transmissions that have begun */
    uint64_t sent;
    uint64_t missed;     /* frames that have not begun in their slots, or that the node refused */
    uint64_t failed;     /* attempts that ended in an error or in a lost arbitration ... */
    uint64_t lost;       /* ... this one */
    uint64_t late_least; /* ticks from the trigger to the start of a transmission */
    uint64_t late_most;
} cw_trigger_stats;

/* The times of a node. */
typedef struct cw_node_time {
    uint64_t local;       /* its local time */
    uint64_t captured;    /* the last capture */
    uint64_t captures;    /* their number so far */
    uint64_t references;  /* ... of reference messages */
    uint64_t cycle_time;  /* local time since the basic cycle began; 0 without in_cycle */
    uint64_t global;      /* local time of the master (L7) */
    uint16_t cycle;       /* number of the basic cycle */
    uint16_t triggers;    /* of its schedule */
    uint8_t master;       /* valid where has_global */
    bool in_cycle;        /* a basic cycle is under way */
    bool has_global;      /* `global` is valid */
} cw_node_time;

/* The captures of one message by the clocks of two nodes, a and b. */
typedef struct cw_time_pair {
    uint64_t a;
    uint64_t b;
} cw_time_pair;

/* Finds the time of a at the time b, by two pairs of captures (L7), rounded down. The counters have
 * a given number of bits, 1..64, and none has come around more than once since the first pair.
 * Returns false when the captures of b are the same. */
bool cw_global_time(const cw_time_pair pairs[2], unsigned bits_a, unsigned bits_b, uint64_t b,
                    uint64_t *a);

typedef struct cw_node_config {
    uint8_t modes;          /* CW_MODE_* */
    cw_order order;         /* the order in which pending frames go (M1) */
    uint16_t queue;         /* frames waiting or being sent, 1..CW_QUEUE_MAX */
    uint16_t queue_room;    /* the most that `queue` can be set to later, at most CW_QUEUE_MAX;
                               there is always room for `queue` and for the settings by the
                               configuration's rules */
    uint16_t warning_limit; /* 1..255 */
    uint64_t restart_ticks; /* from bus-off to the automatic restart request; 0: never (R12) */
    uint8_t protocol;       /* a cw_protocol and CW_PROTOCOL_*; NON_ISO all nodes or none */
    uint8_t variants;       /* CW_VARIANT_* */
    cw_node_timing timing;
    cw_host_config host;
    bool sleeps;            /* from tick 0 on */
    cw_sleep_settings sleep;
    cw_local_time local;
    cw_schedule schedule;   /* needs local time */
} cw_node_config;

/* ---- Counters and checksums in data ---------------------------------------------------------- */

/* A number in the data that counts frames. */
typedef struct cw_counter {
    uint16_t bit;   /* of the most significant one: 8 * byte + bit, bit 0 is the most significant */
    uint8_t bits;   /* 1..32; 0: there is none */
    uint32_t max;   /* after it comes 0 */
    uint32_t start; /* of the first frame */
} cw_counter;

/* The kinds of checksums. CRCs take the most significant bit of a byte first. */
typedef enum cw_checksum_kind {
    CW_CHECKSUM_NONE = 0,
    CW_CHECKSUM_XOR,
    CW_CHECKSUM_SUM,
    CW_CHECKSUM_CRC8,
    CW_CHECKSUM_CRC16, /* two bytes, the low one first */
    CW_CHECKSUM_COUNT
} cw_checksum_kind;

#define CW_DATA_ID_MAX 16

/* A checksum in the data: over all bytes but its own, and over a Data ID, which is not sent. */
typedef struct cw_checksum {
    cw_checksum_kind kind;
    uint8_t at;          /* byte */
    uint16_t polynomial; /* without its highest bit */
    uint16_t start;
    uint16_t inverted;   /* bits that are inverted at the end */
    bool id_first;       /* the Data ID comes before the data, otherwise after them */
    bool id_by_counter;  /* one byte of it, that of the counter modulo id_length; otherwise all of
                            it */
    uint8_t id_length;   /* 0: there is none */
    uint8_t id[CW_DATA_ID_MAX];
} cw_checksum;

/* The frames of a node with one identifier have a counter, a checksum or both, which are written
 * when a host hands them in. Frames that have no such place, and frames of rules, schedules and
 * mailboxes, are left alone. */
typedef struct cw_protection {
    uint8_t node;
    uint32_t id; /* as cw_frame_can_id(), without CW_FILTER_REMOTE */
    cw_counter counter;
    cw_checksum checksum;
} cw_protection;

/* Returns true when a frame has the places of a protection. */
bool cw_protection_fits(const cw_protection *protection, const cw_frame *frame);

/* Writes the counter and the checksum into a frame that has their places. */
void cw_protection_write(const cw_protection *protection, cw_frame *frame, uint32_t counter);

typedef struct cw_bus_config {
    uint32_t bit_ticks; /* ticks of one bit, at least 1: CW_CLOCK_HZ / bit rate */
    uint64_t seed;
    uint8_t node_count; /* 1..CW_NODES_MAX */
    uint16_t inbox;     /* frames handed in for later than now, all nodes together, at least 1 */
    uint16_t events;    /* size of the event ring; raised to the least that works */
    uint16_t rule_count;
    uint16_t rule_room;          /* further rules that can be added while the bus runs */
    bool marks;                  /* room for the marks of cw_bit_view */
    bool start_at_tick; /* a frame for a bus at rest begins at its tick, and the bits of all nodes
                           with it: the bit before is shorter. Otherwise it waits for the next bit.
                           It also waits while bits of nodes differ, a rule acts on bits or on
                           parts of them, or a node integrates, recovers or is suspended */
    bool keeps_setup; /* no node gets a clock or delays later, or falls asleep, by settings or
                         further rules, and the bus takes over no other one. So where no node has
                         any of this from the start, there is no memory for it, and they are
                         CW_INVALID */
    const cw_node_config *nodes; /* node_count of them; not kept */
    const cw_rule *rules;        /* rule_count of them; not kept */
    uint32_t protection_count;
    const cw_protection *protections; /* sorted by node and id, which are distinct; not kept */
} cw_bus_config;

/* Events of one node at one tick come in this order; faults come before all nodes. */
typedef enum cw_event_kind {
    CW_EVENT_FAULT = 0,
    CW_EVENT_LINK, /* the host has put the node on the bus or taken it off */
    CW_EVENT_DROP,
    CW_EVENT_RESTART,
    CW_EVENT_ARBITRATION_LOST,
    CW_EVENT_IMPROPER, /* it has won the arbitration though a lower identifier was pending: one that
                          was handed in before the start of SOF, to a node that may send then. Such
                          a node is not bus-off, integrating, suspended (M8) or silent */
    CW_EVENT_ERROR,
    CW_EVENT_TOLERATED, /* CW_REPORT_TOLERATED; for drivers' error frames, not in event streams */
    CW_EVENT_OVERLOAD,
    CW_EVENT_EXCEPTION, /* protocol exception: the node leaves a frame without an error (D16) */
    CW_EVENT_OVERRUN,   /* a received frame is lost: the host has not fetched the ones before */
    CW_EVENT_RX,
    CW_EVENT_TX,
    CW_EVENT_WAKE, /* a sleeping node is woken; its new state comes when it is awake */
    CW_EVENT_STATE,
    CW_EVENT_SKIP, /* the host has let time pass without the bus; the bus itself makes none */
    CW_EVENT_SYNC, /* its clock has been moved by an edge (T4, T5); only where the bit timings of
                      nodes differ, and only when asked for: cw_bus_set_events() */
    CW_EVENT_CAPTURE, /* a frame is over, and the node has captured its SOF or the last bit of its
                         EOF (L3); only when asked for */
    CW_EVENT_COUNT
} cw_event_kind;

/* All kinds but synchronisations and captures, as bits 1u << cw_event_kind. A bus has several
 * synchronisations in each frame, and goes bit by bit while somebody wants them. */
#define CW_EVENTS_USUAL                                                                            \
    (((1u << CW_EVENT_COUNT) - 1) & ~(1u << CW_EVENT_SYNC) & ~(1u << CW_EVENT_CAPTURE))

/* Returns the name used in events and fault rules ("arbitration-lost"), a constant string. */
const char *cw_event_name(cw_event_kind kind);

/* Why a node has been woken. The names are the "by" of wake events. */
typedef enum cw_wake {
    CW_WAKE_PATTERN = 0, /* a dominant phase */
    CW_WAKE_FRAME,
    CW_WAKE_HOST,
    CW_WAKE_COUNT
} cw_wake;

const char *cw_wake_name(cw_wake wake); /* "pattern" "frame" "host" */

typedef struct cw_event {
    uint64_t tick;  /* end of the bit (rounded up), or when a dropped frame was handed in */
    uint64_t nodes; /* nodes that it concerns; several only for RX of the same frame; 0: the bus */
    cw_event_kind kind;
    uint16_t tec;   /* of the node after the bit: ERROR, TOLERATED, STATE, ARBITRATION_LOST ... */
    uint16_t rec;
    cw_error error; /* ERROR; TOLERATED: role and place only */
    union {
        uint32_t hit;           /* FAULT: 1 for the first hit of the rule */
        uint32_t pending;       /* IMPROPER: the lowest pending identifier, as cw_frame_can_id() */
        uint32_t can_id;        /* ERROR: of the frame it belongs to, as cw_frame_can_id(). At a
                                   receiver in the arbitration it is that of the winner */
        int32_t phase_error_tq; /* SYNC: of the edge, in quanta (T5); 0 of a hard one */
    };
    union {
        uint16_t rule;    /* FAULT: index of the rule */
        uint16_t trigger; /* TX, ARBITRATION_LOST; DROP: ONE_SHOT, SLOT_MISSED: 1 + number of the
                             trigger whose frame it was; 0: none */
    };
    uint8_t state;  /* STATE: the new one, a cw_state */
    uint8_t state_before; /* STATE */
    uint8_t why;    /* DROP: a cw_drop; WAKE: a cw_wake */
    uint8_t lost_bit; /* ARBITRATION_LOST */
    union {
        bool up;   /* LINK */
        bool fast; /* ERROR: it was found at the data rate (D10) */
    };
    bool hard;      /* SYNC: a hard synchronisation (T4), otherwise a resynchronisation (T5) */
    uint64_t from;  /* RX, TX: the sender; several when their frames were the same on the wire; 0: a
                       node that cw_bus_take_over() has left behind. IMPROPER: where the lower
                       identifier was pending. ERROR: the nodes that send the frame it belongs to,
                       or have just been stopped; 0: it belongs to no frame of a node, as in an
                       overload frame, in bits of a rule, and behind a pulse taken for a SOF */
    uint64_t handed_in; /* RX, TX: tick at which the (first) sender's host handed it in; CW_NEVER:
                           the sender has left the bus before the receivers had the frame */
    union {
        uint64_t ticks;      /* SKIP: the time skipped */
        uint64_t late;       /* TX of a trigger: ticks from the trigger to the start of the frame */
        uint64_t local_time; /* CAPTURE */
        cw_span phase_error; /* SYNC: the same as a time */
    };
    cw_frame frame; /* ARBITRATION_LOST, IMPROPER, DROP, OVERRUN, RX, TX, CAPTURE; only these have
                       one. Last, since the ring keeps a classical one in its short form */
} cw_event;

#define CW_BIT_RATIO_MAX 64  /* between the bits of a node and those of the bus */
#define CW_DELAY_BITS_MAX 16 /* of the shortest bits of a node */

/* The limits of a configuration. */
typedef enum cw_limit {
    CW_LIMIT_NONE = 0,   /* it is within all of them */
    CW_LIMIT_BUS,        /* the ticks of a bit, the number of nodes, the inbox */
    CW_LIMIT_TIMING,     /* the segments, the quantum or the data phase of a node by themselves */
    CW_LIMIT_WAY,        /* a delay, a place, a stub or the ringing of a node: CW_DELAY_MAX */
    CW_LIMIT_LONG_BITS,  /* bits over 1.7 s have no clocks and no delays of nodes */
    CW_LIMIT_BIT_MOST,   /* the bit of a node: CW_BIT_RATIO_MAX bits of the bus */
    CW_LIMIT_BIT_LEAST,  /* ... or one of its data phase: that part of one */
    CW_LIMIT_DELAY,      /* from a node to another one, or to itself: CW_DELAY_BITS_MAX bits */
    CW_LIMIT_RULES,      /* CW_RULES_MAX, with rule_room */
    CW_LIMIT_NODE,       /* any other value of a node */
    CW_LIMIT_PROTECTION, /* an entry of protections */
} cw_limit;

/* A limit that a configuration is outside of. */
typedef struct cw_bus_finding {
    cw_limit limit;
    uint8_t node;    /* of TIMING to DELAY, and of NODE: it is about this node */
    uint8_t other;   /* of DELAY: the node to which the way goes */
    bool fast;       /* of BIT_LEAST: it is a bit of the data phase */
    cw_span is;      /* of BIT_MOST, BIT_LEAST and DELAY: the bit, or the delay, ... */
    cw_span allowed; /* ... and the most, or the least, that it may be */
} cw_bus_finding;

/* Returns the first limit that a configuration is outside of. Within all of them cw_bus_size() is
 * not 0, and cw_bus_init() makes a bus if it takes each rule, see cw_bus_add_rule(). */
cw_bus_finding cw_bus_check(const cw_bus_config *config);

/* Returns the bytes that cw_bus_init() needs, or 0 when cw_bus_check() finds something. */
size_t cw_bus_size(const cw_bus_config *config);

/* Returns true when cw_node_set() takes the bit timing of these settings, from the configuration's
 * bit timing of a node that exists. */
bool cw_bus_config_takes(const cw_bus_config *config, unsigned node, const cw_settings *settings);

/* Sets up a bus at tick 0 in memory of cw_bus_size() bytes, aligned as malloc aligns. The memory
 * stays the caller's; throwing it away ends the bus. Returns NULL when the configuration is
 * invalid. */
cw_bus *cw_bus_init(void *memory, const cw_bus_config *config);

/* Returns the bytes that cw_bus_copy() needs now. At most they are those of cw_bus_size() and of
 * the records of cw_bus_set_sync_records(). A bus that has just been made, without rules, needs
 * fewer. */
size_t cw_bus_copy_size(const cw_bus *bus);

/* Copies a bus, between any two calls: its time, nodes, frames, rules, settings and counters,
 * events that have not been taken, and records of synchronisations. The copy is not a bus, and may
 * be moved. */
void cw_bus_copy(const cw_bus *bus, void *copy);

/* Takes a bus back, or forward, to where it was copied. The same calls then have the same results
 * again. The copy is of this bus in this memory, since cw_bus_init() made it, and stays as it is.
 * The texts and records that the bus used then must still be there. */
void cw_bus_restore(cw_bus *bus, const void *copy);

/* Takes a bus back to tick 0, without rules, and with another seed. This costs less than
 * cw_bus_init(). copy: made when cw_bus_init() had just made the bus, of a configuration without
 * rules. Its `rule_room` is for rules that are added now. */
void cw_bus_begin_again(cw_bus *bus, const void *copy, uint64_t seed);

/* Continues an old bus: takes over its time and statistics. Node i gets the state, counters and
 * frames of the old node from[i], with its own new settings. With CW_NO_NODE it is a new node,
 * which integrates. Rules start anew; frames that old rules held back are released. The new bus
 * must be at tick 0, and the events of the old one must have been taken. The old bus may be thrown
 * away afterwards. Frames of nodes that the new bus does not have are lost: see cw_node_flush().
 * Frames for which a smaller queue has no room are dropped with an event. Flushed nodes stay off
 * the bus. Node i is off the bus when the old one is; a new node stays as cw_node_attach() has set
 * it. CW_INVALID, with nothing changed: another bit rate, no such node, a node that is named twice,
 * an inbox too small for the frames that wait. A bus that keeps its setup takes over none. */
cw_status cw_bus_take_over(cw_bus *bus, cw_bus *old, const uint8_t *from);

/* Drops all frames of a node with events (CW_DROP_REMOVED), later ones too. The node leaves the bus
 * for good, whatever rules and hosts do. CW_FULL: poll events, then call again. CW_INVALID: no such
 * node. */
cw_status cw_node_flush(cw_bus *bus, unsigned node);

/* Returns the tick up to which the bus has been simulated. It is always the end of a bit. */
uint64_t cw_bus_now(const cw_bus *bus);

/* Returns the tick at which that many bits to come will have passed. The first one may be a short
 * one of a data phase, the others count as nominal ones. */
uint64_t cw_bus_tick_after(const cw_bus *bus, uint64_t bits);

/* Hands a frame to a node at a tick. A tick before cw_bus_now() counts as now. The frame takes part
 * in the first bit that starts at or after at_tick. It is dropped with an event when the node
 * cannot take it (queue full, bus-off, listen-only, bad frame). After a restart request it waits
 * until the node is back (R12). A frame for CW_NEVER never becomes due: it keeps its place in the
 * inbox, and counts as pending, until cw_node_flush(). CW_FULL: the inbox is full. Advance the bus
 * to one bit after cw_bus_inbox_first(), since that frame is due by then, and call again.
 * CW_INVALID: no such node. */
cw_status cw_node_send(cw_bus *bus, unsigned node, const cw_frame *frame, uint64_t at_tick);

/* Returns false while a node drops all frames: in bus-off before the restart request, listen-only,
 * restricted, off the bus. Returns false also when there is no such node. */
bool cw_node_takes_frames(const cw_bus *bus, unsigned node);

/* Returns how many frames a node can be handed now without a drop for want of room in its queue.
 * Frames that are not due yet and frames that rules hold back count as queued. Returns CW_QUEUE_MAX
 * while the node takes no frames. Rules may fill the queue, too, before the frames become due. */
unsigned cw_node_room(const cw_bus *bus, unsigned node);

/* Returns how many frames for later the inbox still takes. */
unsigned cw_bus_inbox_room(const cw_bus *bus);

/* Brings frames that are not due yet forward by that many ticks, but not before cw_bus_now(). Their
 * order stays, and so do frames for CW_NEVER. This is for a bus whose time stood still while the
 * time of its hosts went on. */
void cw_bus_bring_forward(cw_bus *bus, uint64_t ticks);

/* Does the same for the frames of some nodes, a set. It is for hosts of two kinds: the time of some
 * went on, and the time of the others stood still with the bus. */
void cw_nodes_bring_forward(cw_bus *bus, uint64_t nodes, uint64_t ticks);

/* Returns the tick of the earliest frame that was handed in and is not due yet, or CW_NEVER. */
uint64_t cw_bus_inbox_first(const cw_bus *bus);

/* Returns true while all nodes begin and sample each bit together. They do so where all clocks, bit
 * timings and delays agree, and no rule acts for a part of a bit. */
bool cw_bus_is_on_grid(const cw_bus *bus);

/* Returns the earliest tick at which an event can be expected if nothing is put in. That is the
 * next end of a frame, restart, or release from the inbox; CW_NEVER when the bus rests. An edge
 * that is still under way may synchronise a node even then. Errors, lost arbitrations, overload
 * frames, synchronisations, wake-ups, hits of rules and new states may come before, and drops that
 * follow from them. Their events carry the tick. Off the grid, and where a node has a data rate, an
 * event may come up to a bit time of the bus earlier. The tick may lie inside a bit, where a frame
 * is due. An advance to it does nothing then, so a loop goes on at least to cw_bus_tick_after(1).
 * cw_bus_next_event() has the very tick of any event. */
uint64_t cw_bus_next(const cw_bus *bus);

/* Returns the latest tick that is known now at which a rule acts, or ends its action, by itself.
 * Those are times of CW_TRIGGER_TIME, ends of actions that last, and armings of CW_TRIGGER_ARMED
 * that are under way. Of again_ticks the next one counts. 0: there is none to come. */
uint64_t cw_bus_rules_until(const cw_bus *bus);

/* Returns how far the bus surely rests, at most to tick. All bits up to there are recessive, and no
 * node is busy. Something may be due at the end of the last one. Returns cw_bus_now() when the next
 * bit must be simulated to know. */
uint64_t cw_bus_rests_until(cw_bus *bus, uint64_t tick);

/* A test of frames that a node sends, by a caller. */
typedef bool cw_frame_test(const void *user, unsigned node, const cw_frame *frame);

/* Returns a tick before which no host receives a frame that passes a test, if nothing is put in.
 * CW_NEVER: no such frame waits. Rules and mailboxes may make one of any frame. Events may come
 * earlier as for cw_bus_next(). */
uint64_t cw_bus_next_rx(const cw_bus *bus, cw_frame_test *test, const void *user);

/* Simulates all bits that end at or before tick. CW_FULL: stopped early because the event ring
 * might not hold the events of another bit; poll, then call again. Nothing is lost. */
cw_status cw_bus_advance(cw_bus *bus, uint64_t tick);

/* Does the same, but stops early with CW_AGAIN after that much work since the call, and after at
 * least one bit. A bit is not divided, whatever rules do in it. Call again to continue. The results
 * do not depend on where an advance stops. This is for callers that watch a clock, since the work
 * before a tick is not known beforehand. With rules that send faster than the bus it has no end. */
cw_status cw_bus_advance_some(cw_bus *bus, uint64_t tick, uint64_t work);

/* Returns the tick of the first event of some kinds if nothing is put in. CW_NEVER: there is none
 * up to the tick `until`. The bus goes there and comes back, so it is as it was. An advance to the
 * tick makes the event. kinds: bits 1u << cw_event_kind, which need not be those of
 * cw_bus_set_events(). Events that have not been taken do not count. until: below CW_NEVER, and not
 * too far, since traffic without such an event is simulated up to there. copy: memory of
 * cw_bus_copy_size() bytes. It has a copy of the bus afterwards. */
uint64_t cw_bus_next_event(cw_bus *bus, void *copy, uint32_t kinds, uint64_t until);

/* Returns the work done so far, in units that take about the same time, below a microsecond. Units
 * are single bits, steps that replace bits, rules that were looked at, frames of rules, and events.
 * Time in which nothing happens costs nothing. */
uint64_t cw_bus_work(const cw_bus *bus);

/* Simulates every node in every bit and skips nothing, from the next bit on. The results are the
 * same; this mode is the reference. It is off after cw_bus_init(). */
void cw_bus_set_stepping(cw_bus *bus, bool stepping);

/* Lets every node go by its own clock, from the next bit on, even where all clocks agree. The
 * results are the same; this mode is the reference. It is off after cw_bus_init(). It stays off
 * where a bit lasts longer than 1.6 s, and on a bus without clocks that keeps its setup. */
void cw_bus_set_own_clocks(cw_bus *bus, bool own);

/* Simulates each bit by itself, from the next bit on, for callers of cw_bus_get_bit(). Nodes that
 * do the same are simulated together. This mode is off after cw_bus_init(). */
void cw_bus_set_watching(cw_bus *bus, bool watching);

/* Returns how far the bus may go with nothing to be seen. The last bit up to tick is left out. All
 * bits up to there are the same as the last one, of an idle bus or of a frame. In a frame they are
 * in the same byte of data, or in the same other field. Returns cw_bus_now() when the next bit must
 * be looked at, or when the last one was not simulated by itself. */
uint64_t cw_bus_quiet_until(cw_bus *bus, uint64_t tick);

/* Selects the kinds of events that are kept for cw_bus_poll(), as bits 1u << cw_event_kind. The
 * others only count in the statistics. CW_EVENTS_USUAL are kept after cw_bus_init(). Without lost
 * arbitrations a bus with many busy nodes is faster. */
void cw_bus_set_events(cw_bus *bus, uint32_t kinds);

/* Returns those nodes of an event that come after another event of the bus, by tick, then rule or
 * node, then kind. UINT64_MAX: the whole event. Frames that are handed in at a tick may be dropped
 * at it, when events of a bit that ended then have been taken already. These drops come behind. */
uint64_t cw_event_part_behind(const cw_event *e, const cw_event *other);

/* Takes the oldest event. Returns false when there is none. Data of its frame beyond
 * cw_frame_length() are undefined. */
bool cw_bus_poll(cw_bus *bus, cw_event *event);

/* Events in a row, read with cw_event_at(). */
typedef struct cw_event_row {
    const unsigned char *first;
    size_t size; /* of each one */
    unsigned count;
} cw_event_row;

/* Returns the n-th event of a row. Of its frame only the first cw_frame_length() bytes of data are
 * there, so do not copy the event: see cw_bus_poll(). */
static inline const cw_event *cw_event_at(const cw_event_row *row, unsigned n)
{
    return (const cw_event *)(const void *)(row->first + n * row->size);
}

/* Returns the oldest events in place; a count of 0: there are none. They stay as they are until
 * they are taken, time goes on, or a call changes a node or a rule. Frames may be handed in. */
cw_event_row cw_bus_peek(const cw_bus *bus);

/* Takes that many of the events of cw_bus_peek(); more may follow them. */
void cw_bus_take(cw_bus *bus, unsigned count);

/* Takes a node off the bus, as `ip link set DEVICE down` stops a CAN controller, or puts it on
 * again. A node that is off neither drives nor samples. Its frames, later ones too, are dropped
 * with events (CW_DROP_LINK_DOWN). Its counters are reset, which ends a bus-off. A node that is put
 * on integrates. Frames that rules hold back stay. All nodes are on at first. Nothing happens when
 * the node is already as requested. CW_FULL: poll events, then call again. CW_INVALID: no such
 * node. CW_REFUSED: it has been flushed. */
cw_status cw_node_attach(cw_bus *bus, unsigned node, bool on);

/* Returns true when a node is on; false also when it has been flushed, or there is no such node. */
bool cw_node_attached(const cw_bus *bus, unsigned node);

/* Restarts a node by hand (R12). Frames handed in before are dropped, those handed in after this
 * call wait until the node is back. CW_REFUSED: it is not bus-off, already restarting, or has
 * restart_ticks != 0. */
cw_status cw_node_restart(cw_bus *bus, unsigned node);

/* Returns false when a rule may take nodes off the grid, or let them sleep. A bus that keeps its
 * setup takes such a rule only from its configuration. */
bool cw_rule_keeps_setup(const cw_rule *rule);

/* Adds a rule while the bus runs; *index is its index in calls, events and statistics. CW_FULL: no
 * room for it. CW_INVALID: it names nodes, rules or values that do not exist, or the bus keeps its
 * setup and the rule does not. */
cw_status cw_bus_add_rule(cw_bus *bus, unsigned *index, const cw_rule *rule);

/* Ends the action of a rule and removes the rule; its index may be used again. Frames that it holds
 * back are released. CW_INVALID: no such rule. */
cw_status cw_bus_clear_rule(cw_bus *bus, unsigned index);

/* Ends the action of a rule, but keeps the rule and its counts. The rule acts again when it matches
 * again. A rule that had no end of its own (CW_NEVER) can so be ended and fired again. Frames that
 * it holds back are released. CW_INVALID: no such rule. */
cw_status cw_bus_stop_rule(cw_bus *bus, unsigned index);

/* Arms a rule by hand, as a hit of its `after` would. CW_REFUSED: the rule is not manual, or is
 * finished. */
cw_status cw_bus_fire_rule(cw_bus *bus, unsigned index);

/* Changes settings of a node at the next bit. A node whose listen-only, loopback or restricted
 * changes leaves the bus and integrates again (M10). Its queue stays, but one that is listen-only
 * or restricted drops it. CW_INVALID: a value is out of range, or there is no room for such a queue
 * (cw_node_config.queue_room). */
cw_status cw_node_set(cw_bus *bus, unsigned node, const cw_settings *settings);

/* Reads all settings as they are now. */
cw_status cw_node_get_settings(const cw_bus *bus, unsigned node, cw_settings *settings);

/* Returns the modes alone, a set of CW_MODE_*; 0 for a node that is not there. */
unsigned cw_node_modes(const cw_bus *bus, unsigned node);

/* Returns the number of consecutive recessive bits on the wire up to now. */
uint64_t cw_bus_recessive_bits(const cw_bus *bus);

/* Returns true when the wire carries no frame and no error signalling: all nodes are idle,
 * suspended or away. */
bool cw_bus_idle(const cw_bus *bus);

/* Returns the number of frames in queues, in the inbox (with those of the next triggers), held
 * back by rules, and in buffers of receivers. */
size_t cw_bus_pending(const cw_bus *bus);

/* ---- The last bit, for traces ---------------------------------------------------------------- */

/* One node in a bit. */
typedef struct cw_bit_node {
    cw_place place;     /* as the node counts it; CW_FIELD_NONE when idle, integrating or off */
    cw_mac_phase phase; /* in this bit */
    cw_role role;       /* in this bit: a node that loses arbitration in it is its transmitter */
    uint8_t wire;       /* number of its wire: 0, and up to 63 where the bus is partitioned */
    cw_state state;     /* after the bit, like the counters */
    uint16_t tec;
    uint16_t rec;
} cw_bit_node;

/* Things that a node does at a moment inside a bit time. */
typedef enum cw_mark_kind {
    CW_MARK_BEGIN = 0, /* it begins a bit, as the first quantum of many */
    CW_MARK_DRIVE,     /* it puts another level onto its wire, or a rule makes it another one */
    CW_MARK_WIRE,      /* the wire of the node has another level; the mark is that of the lowest
                          node of each wire. It is the AND of what the nodes drive at that moment,
                          with what rules make of it: as if it were seen without delay */
    CW_MARK_SAMPLE,    /* it samples a level */
    CW_MARK_LATE_SAMPLE, /* ... at the secondary sample point of a bit that it sends (D13) */
    CW_MARK_HARD_SYNC, /* it has seen an edge, at the end of the quantum of the edge (T4) */
    CW_MARK_RESYNC,    /* ... with a phase error (T5) */
} cw_mark_kind;

typedef struct cw_mark {
    cw_span at;       /* since the start of the bit time; 0 for an edge that came before */
    cw_span quantum;  /* of the node */
    cw_mark_kind kind;
    int16_t phase_error; /* RESYNC: in quanta */
    uint8_t node;
    bool level;       /* DRIVE, WIRE, SAMPLE, LATE_SAMPLE */
    uint8_t phase;    /* cw_mac_phase of its bit in progress ... */
    cw_place place;   /* ... and place, as in cw_bit_node */
} cw_mark;

/* A bit of bus time. In the sets of levels bit i is 1 where the level of node i is recessive, and 1
 * beyond the last node. In the sets of faults it is 1 where rules changed the level in this bit. */
typedef struct cw_bit_view {
    uint64_t start;       /* ticks */
    uint64_t end;
    uint64_t driven;      /* the level that each node puts onto its wire */
    uint64_t wire;        /* the level of the wire that it is on */
    uint64_t sampled;     /* the level that its controller takes; its own bits in loopback (M11,
                             M15). All three are those at the start of the bit where there are
                             marks, which say how they change */
    uint64_t tx_faults;   /* between controller and wire: driven is changed */
    uint64_t wire_faults; /* wire is not the wired-AND of what is driven */
    uint64_t rx_faults;   /* between wire and controller */
    uint64_t alike;       /* nodes whose place, phase and role are known beforehand to be the
                             same */
    uint64_t fast;        /* nodes that begin the bit at the data rate (D10) */
    bool steady;          /* states and counters are known beforehand to be those after the bit
                             before */
    unsigned node_count;
    unsigned wire_count;
    unsigned mark_count;
    const cw_mark *marks; /* in any order, while bits are not common to all nodes and the bus has
                             room for marks; valid until the bus goes on */
    cw_bit_node nodes[CW_NODES_MAX]; /* the first node_count */
} cw_bit_view;

/* Reads the bit that ended at cw_bus_now(). CW_REFUSED, leaving *view alone: the bit was not
 * simulated by itself, see cw_bus_set_watching(). */
cw_status cw_bus_get_bit(const cw_bus *bus, cw_bit_view *view);

/* ---- Statistics: counted since tick 0, read by value ----------------------------------------- */

/* Transmit delay, from hand-in to end of frame. Bucket b counts delays of cw_delay_bucket_ticks(b)
 * <= delay < cw_delay_bucket_ticks(b + 1): four buckets an octave. */
#define CW_DELAY_BUCKETS 128

typedef struct cw_delay {
    uint64_t count;
    uint64_t sum_ticks;
    uint64_t min_ticks; /* 0 when count is 0 */
    uint64_t max_ticks;
    uint32_t bucket[CW_DELAY_BUCKETS];
} cw_delay;

/* Returns the lower edge of a bucket in ticks. */
uint64_t cw_delay_bucket_ticks(unsigned bucket);

/* Returns the delay below which permille of all delays stayed, from the histogram (upper edge, at
 * most the maximum). Returns 0 when there are no delays. permille 500 is the median. */
uint64_t cw_delay_quantile_ticks(const cw_delay *delay, unsigned permille);

/* The members are the rows of the tables of canwire_counters.h; those below are not counters. */
typedef struct cw_node_stats {
    CW_NODE_COUNTERS(CW_MEMBER)
    uint16_t tec;
    uint16_t rec;
    cw_state state;
    cw_delay delay;
} cw_node_stats;

typedef struct cw_bus_stats {
    CW_BUS_COUNTERS(CW_MEMBER)
    uint16_t load_permille; /* busy time of the last second (as far as the bus has run) */
} cw_bus_stats;

/* Reads the statistics of the bus, up to cw_bus_now(). */
void cw_bus_get_stats(const cw_bus *bus, cw_bus_stats *stats);

/* Returns true when every frame of the node is accounted for. handed_in and made_by_rules are the
 * sum of tx_frames, stored, queue, held and dropped. rx_accepted and rx_made_by_rules are the sum
 * of rx_frames, rx_held and rx_dropped. */
bool cw_node_stats_balance(const cw_node_stats *stats);

/* CW_INVALID when there is no such node. */
cw_status cw_node_get_stats(const cw_bus *bus, unsigned node, cw_node_stats *stats);

typedef struct cw_host_stats {
    CW_HOST_COUNTERS(CW_MEMBER)
} cw_host_stats;

/* CW_INVALID: no such node. CW_REFUSED: no node of the bus has filters, buffers or
 * mailboxes. */
cw_status cw_node_get_host_stats(const cw_bus *bus, unsigned node, cw_host_stats *stats);

typedef struct cw_sleep_stats {
    CW_SLEEP_COUNTERS(CW_MEMBER)
} cw_sleep_stats;

/* CW_INVALID: no such node. */
cw_status cw_node_get_sleep_stats(const cw_bus *bus, unsigned node, cw_sleep_stats *stats);

/* Reads the times of a node. CW_INVALID: no such node. CW_REFUSED: it has no local time. */
cw_status cw_node_get_time(const cw_bus *bus, unsigned node, cw_node_time *time);

/* CW_INVALID: no such node, or no such trigger of its schedule. */
cw_status cw_node_get_trigger_stats(const cw_bus *bus, unsigned node, unsigned trigger,
                                    cw_trigger_stats *stats);

/* Counts of one node at the data rate (D10). */
typedef struct cw_data_stats {
    uint64_t errors[CW_ERROR_COUNT]; /* of cw_node_stats.errors, those found at the data rate */
    uint32_t tdcv; /* clocks: the delay of its last own edge to res that it has measured, or as it
                      is given (D13); 0: none */
} cw_data_stats;

/* CW_INVALID: no such node. CW_REFUSED: no node of the bus has a data rate. */
cw_status cw_node_get_data_stats(const cw_bus *bus, unsigned node, cw_data_stats *stats);

/* Synchronisations of one node (T3 to T5), while bits are not common to all nodes. */
typedef struct cw_sync_stats {
    uint64_t hard_syncs;    /* hard synchronisations (T4) */
    uint64_t resyncs;       /* resynchronisations with a phase error other than 0 (T5) */
    int32_t phase_error_tq; /* the largest of these, in quanta: positive where the edge was late */
    cw_span phase_error;    /* the same as a time */
    cw_span margin;         /* the least time between a sample point and a change of the level that
                               the node sees; CW_NO_MARGIN: none yet */
} cw_sync_stats;

#define CW_NO_MARGIN INT64_MAX

/* Adds what was counted later to what was counted before. */
void cw_sync_stats_add(cw_sync_stats *sum, const cw_sync_stats *more);

/* A record of one node, in memory of the caller. The fields are the library's. */
typedef struct cw_sync_record {
    cw_sync_stats stats;
    cw_span sampled_at; /* the last sample point */
    bool measures;      /* edges after it have a margin */
} cw_sync_record;

/* Counts synchronisations from the next bit on, in a record for each node. The records are cleared,
 * and stay the caller's; NULL ends it. This is off after cw_bus_init(). Only time in which the
 * timings of nodes differ counts. The records of a bus with common bits stay empty, also while
 * pulses and jitter take it off the grid. A margin is measured between two samples of different
 * levels. There the level changes with the first dominant edge, or the last recessive one, that
 * nodes drive. Changes by rules and by ringing do not count, and nor do edges at which the node
 * synchronises hard, or could. */
void cw_bus_set_sync_records(cw_bus *bus, cw_sync_record *records);

/* CW_INVALID: no such node. CW_REFUSED: synchronisations are not counted. */
cw_status cw_node_get_sync_stats(const cw_bus *bus, unsigned node, cw_sync_stats *stats);

typedef struct cw_rule_stats {
    uint64_t matches;
    uint64_t misses;  /* matches that were passed over */
    uint64_t hits;    /* the other matches; for NOISE, which a match only begins, the bits that it
                         flipped */
    bool active;      /* it is acting now */
    bool over;        /* finished: its count is used up, or its time has passed */
} cw_rule_stats;

/* Reads the counts of a rule. CW_INVALID: no such rule. */
cw_status cw_rule_get_stats(const cw_bus *bus, unsigned rule, cw_rule_stats *stats);

/* Returns the load between two readings of the same bus: permille of busy time; 0 when no time lies
 * between them. */
unsigned cw_load_permille(const cw_bus_stats *before, const cw_bus_stats *after);

#endif
