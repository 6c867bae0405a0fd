/* SPDX-License-Identifier: MIT
 *
 * pump.h - a thread of the library, for what happens while the program makes no call.
 *
 * Items wait for a descriptor, a time, or both. All functions need the lock of the table, and so
 * do the calls of items.
 */
#ifndef CANWIRE_PRELOAD_PUMP_H
#define CANWIRE_PRELOAD_PUMP_H

#include <stdbool.h>
#include <stdint.h>

#define PUMP_NEVER INT64_MAX

typedef struct pump_item pump_item;

struct pump_item {
    int fd;         /* readable: the item runs; -1: none */
    int64_t due_ns; /* CLOCK_MONOTONIC, or PUMP_NEVER */
    void (*run)(pump_item *self, bool readable);
    void *user;
    pump_item *next; /* of the pump: */
    bool ready;
    bool in_list;
};

int64_t pump_now_ns(void);

/* In virtual time there is no thread: waiting calls of the program run the items. None of these
 * needs the lock. pump_due_ns(): bus time in ns at which the first item is due. */
int64_t pump_due_ns(void);
bool pump_has_items(void);
void pump_step(void);

/* Adds an item, or says that it has changed. The thread starts when there is none. */
void pump_put(pump_item *item);

void pump_remove(pump_item *item);

/* In the child after fork(): the thread is gone. Starts it again when there are items. */
void pump_forked(void);

#endif
