/* SPDX-License-Identifier: MIT
 *
 * canwire-sim.h - CAN buses in virtual time inside a program: libcanwire-sim.
 *
 * It does what `canwire sim` does with the same files: one bus, or the buses of a rig. The program
 * says how far time goes, hands in frames, and reads the frames that nodes receive. The same calls
 * give the same results on every machine.
 *
 * Times are nanoseconds of bus time, from 0 on, in an int64_t. Results are truncated, as in events.
 * Nodes and buses have numbers from 0 on, in the order of the file; the nodes of a rig are counted
 * over all buses. Texts are UTF-8 and end with 0.
 *
 * Instances and texts that are returned as `char *` are the caller's, to be given back with
 * canwire_sim_free() and canwire_sim_free_text(). Texts that are returned as `const char *` are the
 * instance's, and live as long as it says there.
 *
 * Errors: functions that can fail return a negative canwire_sim_status, or NULL. The text of the
 * last error of an instance is canwire_sim_message(). Nothing is written to standard error, no
 * function ends the program or touches signals, and there is no global state. Threads may use
 * different instances at the same time, and one instance one after the other.
 */
#ifndef CANWIRE_SIM_H
#define CANWIRE_SIM_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(__GNUC__)
#define CANWIRE_SIM_API __attribute__((visibility("default")))
#else
#define CANWIRE_SIM_API
#endif

/* Changes with each change of this file that old programs do not understand. */
#define CANWIRE_SIM_ABI 1

#define CANWIRE_SIM_NEVER INT64_MAX /* as a time: there is none, or no limit */

typedef struct canwire_sim canwire_sim;

typedef enum canwire_sim_status {
    CANWIRE_SIM_OK = 0,
    CANWIRE_SIM_INVALID = -1,   /* an argument is wrong, or a text in it; nothing was changed */
    CANWIRE_SIM_REFUSED = -2,   /* not possible now: no such rule, not bus-off; no change */
    CANWIRE_SIM_NO_MEMORY = -3, /* the instance can only be freed or reset */
    CANWIRE_SIM_FAILED = -4     /* a file of traffic can no longer be read */
} canwire_sim_status;

/* ---- Instances ------------------------------------------------------------------------------- */

/* Returns CANWIRE_SIM_ABI of the library. */
CANWIRE_SIM_API int canwire_sim_abi(void);

/* Returns the version of canwire, "0.2.0"; it stays valid. */
CANWIRE_SIM_API const char *canwire_sim_version(void);

/* Reads the file of a bus or of a rig and makes its buses at time 0. Returns NULL when there are
 * errors. *messages gets NULL, or a text for the caller: the errors, or the warnings, a line
 * FILE:LINE:COLUMN: message each. `messages` may be NULL. */
CANWIRE_SIM_API canwire_sim *canwire_sim_load(const char *file, char **messages);

/* Does the same with the text of a file, of that many bytes. `name` stands for it in messages, and
 * paths in the text are relative to its directory. */
CANWIRE_SIM_API canwire_sim *canwire_sim_load_text(const char *text, size_t size, const char *name,
                                                   char **messages);

/* Frees an instance; NULL is allowed. */
CANWIRE_SIM_API void canwire_sim_free(canwire_sim *sim);

/* Frees a text; NULL is allowed. */
CANWIRE_SIM_API void canwire_sim_free_text(char *text);

/* Goes back to time 0 with the configuration as it was read, in the same memory. Rules, settings
 * and expectations are those of the file again, and no frames wait. The seed is *seed, or with NULL
 * that of the file. Nodes are listened to as before, and the same events are kept. This is many
 * times faster than to load the file again. */
CANWIRE_SIM_API int canwire_sim_reset(canwire_sim *sim, const uint64_t *seed);

/* Returns the last error of this instance, "" without one; until the next call of a function that
 * can fail. */
CANWIRE_SIM_API const char *canwire_sim_message(const canwire_sim *sim);

/* Return numbers, and names until the next canwire_sim_free(). The name is NULL for a wrong
 * number. */
CANWIRE_SIM_API int canwire_sim_bus_count(const canwire_sim *sim);
CANWIRE_SIM_API int canwire_sim_node_count(const canwire_sim *sim);
CANWIRE_SIM_API const char *canwire_sim_bus_name(const canwire_sim *sim, int bus);
CANWIRE_SIM_API const char *canwire_sim_node_name(const canwire_sim *sim, int node);
CANWIRE_SIM_API int canwire_sim_bus_of_node(const canwire_sim *sim, int node); /* -1: none */

/* Describes a bus. */
typedef struct canwire_sim_bus {
    uint64_t seed;
    uint32_t bitrate;  /* bit/s */
    uint32_t dbitrate; /* of the data phase of CAN FD frames; 0: the bus has none */
    int32_t nodes;
    int32_t first_node; /* its number */
    int32_t fd;         /* 1: a node knows CAN FD frames */
    int32_t rules;      /* numbers of rules in use are below this */
} canwire_sim_bus;

CANWIRE_SIM_API int canwire_sim_get_bus(const canwire_sim *sim, int bus, canwire_sim_bus *out);

/* ---- Time ------------------------------------------------------------------------------------ */

/* Reads a time such as 10ms, 2s or 100bit, in bits of a bus. Returns it, or CANWIRE_SIM_INVALID. */
CANWIRE_SIM_API int64_t canwire_sim_time(canwire_sim *sim, int bus, const char *text);

/* Returns the time up to which events and frames are known. */
CANWIRE_SIM_API int64_t canwire_sim_now(const canwire_sim *sim);

#define CANWIRE_SIM_NO_NODE (-1)
#define CANWIRE_SIM_ANY_NODE (-2)

/* Says why a run has ended. */
typedef enum canwire_sim_stop {
    CANWIRE_SIM_AT_TIME = 0,
    CANWIRE_SIM_AT_FRAME = 1, /* a frame waits at a node that is listened to */
    CANWIRE_SIM_AT_EVENT = 2, /* the awaited event has come */
    CANWIRE_SIM_AT_END = 3    /* all traffic is done, or none has come for 10 s; see below */
} canwire_sim_stop;

/* Runs up to a time: events with t <= until are known then. With CANWIRE_SIM_NEVER it runs until
 * all traffic is done, queues are empty and 11 recessive bits have passed. It then also ends after
 * 10 s of bus time without a frame or a release, and traffic without an end is an error.
 *
 * event: NULL, or an awaited event as for `canwire sim --until-event`: "engine:bus-off", "rx:123",
 * "error", "fault:RULE". "any" is any event that is kept. In a rig it may begin with the name of a
 * bus, "body:error". The run ends with the bit of that event.
 * frame_at: the run ends when a frame comes to this node, or waits there already. The node has to
 * be listened to. CANWIRE_SIM_ANY_NODE is any such node.
 *
 * Returns a canwire_sim_stop, or a negative status. A run can go on after each of them. */
CANWIRE_SIM_API int canwire_sim_run(canwire_sim *sim, int64_t until, const char *event,
                                    int frame_at);

/* Returns a time before which no node receives a frame, when none is handed in. CANWIRE_SIM_NEVER:
 * none will come. It is a bound that costs little, and may be in the middle of a bit: a loop that
 * runs to it may stand still. canwire_sim_next_event() has the very time. */
CANWIRE_SIM_API int64_t canwire_sim_next(const canwire_sim *sim);

/* Looks for the next event of these kinds behind canwire_sim_now(), when nothing is handed in. They
 * are kinds that are kept, as in canwire_sim_keep_events(). Returns 1 with its time in *at. Returns
 * 0 when none comes before *at. That is `until`, or 10 s from now. It is earlier when the traffic
 * of a file or a gateway may hand in a frame then. Look again when time has come there; events at
 * that time are known then. A look costs as much as to go there, and two copies of the bus. Nothing
 * happens by it. CANWIRE_SIM_INVALID: there are no such events, or they are not kept; `until` is
 * before now. */
CANWIRE_SIM_API int canwire_sim_next_event(canwire_sim *sim, const char *kinds, int64_t until,
                                           int64_t *at);

/* ---- Frames ---------------------------------------------------------------------------------- */

#define CANWIRE_SIM_FRAME_FD 0x01u    /* CAN FD frame */
#define CANWIRE_SIM_FRAME_BRS 0x02u   /* ... with a faster data phase */
#define CANWIRE_SIM_FRAME_ESI 0x04u   /* ... from a node that is error passive */
#define CANWIRE_SIM_FRAME_OWN 0x08u   /* read: the node has sent it */

/* A frame. `can_id` has the identifier and the flags of linux/can.h: CAN_EFF_FLAG 0x80000000,
 * CAN_RTR_FLAG 0x40000000, CAN_ERR_FLAG 0x20000000 of error frames, which are only read. */
typedef struct canwire_sim_frame {
    int64_t t; /* read: the time at which the node got it */
    uint32_t can_id;
    uint8_t flags;   /* CANWIRE_SIM_FRAME_* */
    uint8_t length;  /* bytes of data; of a remote frame the DLC: 0..8, 0..64 of an FD frame */
    uint8_t raw_dlc; /* of a classical frame: 9..15 on the wire, with 8 bytes; otherwise 0 */
    uint8_t reserved;
    uint8_t data[64];
} canwire_sim_frame;

/* Hands a frame to a node at a time; before now counts as now. Events show what happens to it on
 * the bus, drops included. The lengths of FD frames are
 * rounded up to the next possible one, with zeros. CANWIRE_SIM_INVALID: no such node, or no such
 * frame exists. CANWIRE_SIM_REFUSED: too many frames wait for a later time. */
CANWIRE_SIM_API int canwire_sim_send(canwire_sim *sim, int node, const canwire_sim_frame *frame,
                                     int64_t at);

#define CANWIRE_SIM_LISTEN_RX 0x1     /* frames that the node's host receives */
#define CANWIRE_SIM_LISTEN_OWN 0x2    /* frames that the node has sent successfully */
#define CANWIRE_SIM_LISTEN_ERRORS 0x4 /* error frames of linux/can/error.h, as by its driver */

/* Says which frames of a node are kept for canwire_sim_receive(): a set of CANWIRE_SIM_LISTEN_*, 0
 * for none, which is so at first. Frames that are kept already stay. */
CANWIRE_SIM_API int canwire_sim_listen(canwire_sim *sim, int node, int what);

/* Takes the next frame of a node. Returns 1, or 0 when there is none up to now. */
CANWIRE_SIM_API int canwire_sim_receive(canwire_sim *sim, int node, canwire_sim_frame *out);

/* Hands a frame to a node, as canwire_sim_send() does, when there is room in the queue then: time
 * first goes on to `at`. Returns 1, or 0 without room. */
CANWIRE_SIM_API int canwire_sim_offer(canwire_sim *sim, int node, const canwire_sim_frame *frame,
                                      int64_t at);

/* The end of canwire_sim_wait(). */
typedef struct canwire_sim_waited {
    int64_t now;             /* canwire_sim_now() */
    int64_t next;            /* without a frame: canwire_sim_next() */
    canwire_sim_frame frame; /* with one */
} canwire_sim_waited;

/* Takes the next frame of a node, which is listened to. Without one, time goes on until one comes:
 * up to a time at most, and for so long at most. Returns 1, or 0 when there is none up to then. It
 * is canwire_sim_run() and canwire_sim_receive() in one call. */
CANWIRE_SIM_API int canwire_sim_wait(canwire_sim *sim, int node, int64_t until, int64_t span,
                                      canwire_sim_waited *out);

/* Returns how many frames the node still takes before its queue is full. A node that is bus-off
 * before its restart, listen-only or off the bus drops all of them: 4096. */
CANWIRE_SIM_API int canwire_sim_room(const canwire_sim *sim, int node);

/* ---- Faults and settings --------------------------------------------------------------------- */

/* Adds rules to a bus, all or none, as `canwire inject` does: YAML or JSON, a rule, a list of rules
 * or a profile. `name` stands for the text in messages. *messages as for
 * canwire_sim_load(). */
CANWIRE_SIM_API int canwire_sim_inject(canwire_sim *sim, int bus, const char *text, size_t size,
                                       const char *name, char **messages);

/* Removes a rule, or all injected ones with NULL. */
CANWIRE_SIM_API int canwire_sim_clear(canwire_sim *sim, int bus, const char *rule);

/* Fires a rule with `manual: yes`. */
CANWIRE_SIM_API int canwire_sim_fire(canwire_sim *sim, int bus, const char *rule);

/* Returns the name of a rule, or NULL where there is none. */
CANWIRE_SIM_API const char *canwire_sim_rule_name(const canwire_sim *sim, int bus, int rule);

/* Restarts a node that is bus-off. */
CANWIRE_SIM_API int canwire_sim_restart(canwire_sim *sim, int node);

/* Changes settings of a node, a JSON object with the keys of `canwire set`. */
CANWIRE_SIM_API int canwire_sim_set(canwire_sim *sim, int node, const char *json);

/* Takes a node off the bus (0), as `ip link set DEVICE down` does, or puts it on again (1). */
CANWIRE_SIM_API int canwire_sim_attach(canwire_sim *sim, int node, int on);

/* ---- Results --------------------------------------------------------------------------------- */

/* Says which events are kept from now on: "all" (but sync and capture, which cost time), "none", or
 * names of kinds with commas: "error,state,fault,sync". At first it is "all". */
CANWIRE_SIM_API int canwire_sim_keep_events(canwire_sim *sim, const char *kinds);

/* Takes the events up to now that have not been taken: a line of JSON each, as `canwire sim
 * --events` writes them. *size gets the bytes; it may be NULL. Returns NULL without memory. */
CANWIRE_SIM_API char *canwire_sim_take_events(canwire_sim *sim, size_t *size);

#define CANWIRE_SIM_NO_FRAME 0x20000000u /* in the place of an identifier */

/* Marks of errors. */
#define CANWIRE_SIM_MARK_TX 0x01u      /* the node was the transmitter */
#define CANWIRE_SIM_MARK_STUFF 0x02u   /* it was a stuff bit behind that of the index */
#define CANWIRE_SIM_MARK_DATA 0x04u    /* it was found at the data rate */
#define CANWIRE_SIM_MARK_ACTIVE 0x08u  /* an active error flag follows, */
#define CANWIRE_SIM_MARK_PASSIVE 0x10u /* a passive one, or with neither none */

/* Places for columns of events, each with a member for each row; NULL: the column is not wanted. A
 * row is a line of canwire_sim_take_events(). Members that an event does not have are 0. Numbers of
 * words are those of canwire_sim_word(). */
typedef struct canwire_sim_columns {
    int64_t *t;
    int16_t *bus;      /* its number */
    int16_t *node;     /* its number, or -1 of an event of the bus */
    uint8_t *event;    /* a word: "rx", "error" ... */
    uint8_t *detail;   /* a word: the new state, the type of an error, why a frame was dropped, what
                          woke the node, up or down */
    uint8_t *field;    /* a word: where an error was */
    uint8_t *marks;    /* CANWIRE_SIM_MARK_* */
    uint32_t *number;  /* the index of an error in the field, the bit of a lost arbitration, the hit
                          of a rule */
    uint16_t *rule;    /* the line of `rules` with the name of the rule, from 0 on */
    uint16_t *tec;     /* of errors and states */
    uint16_t *rec;     /* ... */
    uint32_t *can_id;  /* of the frame, as in canwire_sim_frame, or CANWIRE_SIM_NO_FRAME */
    uint8_t *flags;    /* ... */
    uint8_t *length;   /* ... */
    uint8_t *raw_dlc;  /* ... */
    uint32_t *error_id; /* of an error: the can_id of the frame it belongs to, at a receiver in the
                           arbitration that of the winner. CANWIRE_SIM_NO_FRAME: it belongs to no
                           frame of a node, as in overload frames and behind a pulse */
    uint8_t *data;     /* data_size bytes in each row; zeros follow those of the frame */
    int32_t data_size; /* 1..64 */
} canwire_sim_columns;

/* Returns how many rows the events up to now make that have not been taken. */
CANWIRE_SIM_API int64_t canwire_sim_count_events(const canwire_sim *sim);

/* Takes events as canwire_sim_take_events() does, but as columns, up to a number of rows. Returns
 * the number of rows that it has written. *rules gets a text for the caller: names of rules, a line
 * each; or NULL without any. CANWIRE_SIM_INVALID: data_size is wrong. */
CANWIRE_SIM_API int64_t canwire_sim_take_columns(canwire_sim *sim,
                                                 const canwire_sim_columns *columns, int64_t rows,
                                                 char **rules);

/* Returns a word of the columns, as events have it; 0 is "". NULL: there is no such word. */
CANWIRE_SIM_API const char *canwire_sim_word(int number);

/* The states of a node. */
#define CANWIRE_SIM_ERROR_ACTIVE 0
#define CANWIRE_SIM_ERROR_WARNING 1
#define CANWIRE_SIM_ERROR_PASSIVE 2
#define CANWIRE_SIM_BUS_OFF 3
#define CANWIRE_SIM_SLEEPING 4

/* A node now, and what it has counted since time 0. */
typedef struct canwire_sim_node {
    uint64_t tx_frames;
    uint64_t rx_frames;
    uint64_t dropped;    /* frames on their way onto the bus */
    uint64_t rx_dropped; /* ... and on their way to the host */
    uint64_t arbitration_lost;
    uint64_t retransmissions;
    uint64_t bit_errors;
    uint64_t stuff_errors;
    uint64_t form_errors;
    uint64_t crc_errors;
    uint64_t ack_errors;
    uint64_t overloads;
    uint32_t bus_off; /* times */
    uint32_t restarts;
    uint32_t queue; /* frames that wait, or are being sent */
    uint32_t inbox; /* frames for a later time */
    uint16_t tec;
    uint16_t rec;
    uint8_t state;       /* CANWIRE_SIM_ERROR_ACTIVE ... */
    uint8_t attached;    /* 1: it is on the bus */
    uint8_t fd;          /* 1: it knows CAN FD frames; otherwise it drops them as bad frames */
    uint8_t listen_only; /* 1: it only listens */
} canwire_sim_node;

CANWIRE_SIM_API int canwire_sim_get_node(const canwire_sim *sim, int node, canwire_sim_node *out);

/* Returns all statistics of a bus as a JSON object, as `canwire sim --stats` writes them; of all
 * buses of a rig and its gateways with -1. NULL without memory, or for a wrong number. */
CANWIRE_SIM_API char *canwire_sim_stats(canwire_sim *sim, int bus);

/* Adds expectations to a bus, YAML or JSON as under `expect` of a file: one, or a list. They judge
 * what comes from now on. *messages as for canwire_sim_load(). */
CANWIRE_SIM_API int canwire_sim_expect(canwire_sim *sim, int bus, const char *text, size_t size,
                                       const char *name, char **messages);

/* Returns the expectations of all buses, those of the files first, as they are met up to now. It is
 * a JSON array of objects with `bus`, `name`, `wanted`, `got` and `met`. NULL without memory. */
CANWIRE_SIM_API char *canwire_sim_expectations(canwire_sim *sim);

/* Returns the losses up to now, as `canwire sim` tells them at its end. They are frames that were
 * dropped or never sent, and rules of the files that never matched. It is a JSON array of objects
 * with `bus`, `node` or `rule`, `why`, and `frames`, `ids`, `help` where there are any. NULL
 * without memory. */
CANWIRE_SIM_API char *canwire_sim_lost(canwire_sim *sim);

#ifdef __cplusplus
}
#endif

#endif
