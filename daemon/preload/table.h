/* SPDX-License-Identifier: MIT
 *
 * table.h - the descriptors of a program that are CAN sockets, and those that it must not see.
 *
 * One lock is for all state of this library. Nobody waits for a bus while holding it.
 */
#ifndef CANWIRE_PRELOAD_TABLE_H
#define CANWIRE_PRELOAD_TABLE_H

#include "preload/ifmap.h"

#include <linux/can.h>
#include <stdint.h>
#include <sys/epoll.h>
#include <sys/types.h>

#define TABLE_MAX 65536

typedef enum cansock_kind { CANSOCK_RAW, CANSOCK_BCM } cansock_kind;

/* Time stamps next to a message, as the options of SOL_SOCKET ask for them. */
typedef struct cansock_stamps {
    int option;       /* SO_TIMESTAMP or SO_TIMESTAMPNS, old or new; 0: none */
    int timestamping; /* SO_TIMESTAMPING, old or new; 0: none */
    unsigned flags;   /* of SO_TIMESTAMPING */
    bool overflow;    /* SO_RXQ_OVFL */
} cansock_stamps;

/* Options of CAN_RAW. */
typedef struct cansock_raw {
    struct can_filter *filters;
    unsigned filter_count;
    bool filters_set; /* otherwise all frames pass */
    can_err_mask_t error_mask;
    int loopback;
    int recv_own;
    int fd_frames;
    int join;
} cansock_raw;

struct bcm;
struct relay;
typedef struct watch watch;

typedef struct cansock {
    cansock_kind kind;
    unsigned uses;        /* descriptors, and calls that run */
    unsigned descriptors;
    ino_t inode;          /* of the socket behind them: others have been closed unseen */
    bool shared;          /* it is the parent's: nobody waits here for its last frames */
    bool bound;
    int index;            /* of the interface; 0: all */
    int direct;           /* the interface whose connection the socket itself is, or -1 */
    int side[IFMAP_MAX];  /* hidden connections of other interfaces, or -1 */
    uint64_t sent[IFMAP_MAX]; /* frames; back to 0 when the bus has sent them */
    unsigned flushed;     /* answers to flushes that a receiving thread has read; atomic */
    int64_t stamp_ns;     /* of the last message that was received; 0: none */
    cansock_stamps stamps;
    cansock_raw raw;
    watch *watches;       /* in epoll sets */
    struct relay *relay;  /* another socket than a connection feeds the program's; or NULL */
    struct bcm *bcm;
} cansock;

void table_lock(void);
void table_unlock(void);

/* Makes the entry of a new descriptor. Returns NULL with errno when there is no room. */
cansock *table_new(int fd, cansock_kind kind);

/* Returns the socket of a descriptor, NULL for any other one. The caller gives it back. */
cansock *table_take(int fd);
void table_give(cansock *s);
void table_give_locked(cansock *s);

/* Adds another descriptor of a socket. */
void table_add(int fd, cansock *s);

/* Forgets a descriptor. The caller holds the lock. */
void table_forget(int fd);

/* Returns true when a call concerns a socket or hidden descriptor, in this process: the child of
 * vfork() shares the memory, but not the descriptors. */
bool table_concerns(int fd);

/* Puts another socket under all descriptors of one. The caller holds the lock; fd is closed. */
void table_replace(cansock *s, int fd);

/* Returns the socket of a descriptor that has one. The caller holds the lock. */
cansock *table_at(int fd);

/* Returns the next descriptor with a socket from fd on, or -1. */
int table_next(int fd);

/* Moves a descriptor to a place where the program does not expect any; it stays there. */
int table_hide(int fd);
void table_close_hidden(int fd);

/* Keeps a hidden descriptor, which may be -1, open for a call without the lock: one that is closed
 * meanwhile closes with the last release. The caller has the lock for both. Returns it. */
int table_hold(int fd);
void table_release(int fd);
bool table_is_hidden(int fd);

/* Returns true in the process to which the memory belongs. */
bool table_is_own_process(void);

/* Is called when the last use of a socket ends, with the lock. */
extern void (*table_on_end)(cansock *s);

/* In the child after fork(), with the lock. */
void table_forked(void);

/* ---- watch.c: the epoll sets in which a program has put a CAN socket ------------------------- */

/* The kernel takes a descriptor out of them when another socket is put under it. All functions need
 * the lock. */

/* Notes a call of epoll_ctl() that was successful. */
void watch_note(watch **first, int set, int operation, int fd, const struct epoll_event *event);

/* Takes a descriptor out of its sets, before it gets another socket, and puts it in again. */
void watch_suspend(watch *first, int fd);
void watch_resume(watch *first, int fd);

/* Forgets the sets of a descriptor. */
void watch_forget(watch **first, int fd);

#endif
