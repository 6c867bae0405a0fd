/* SPDX-License-Identifier: MIT
 *
 * notify.h - reports the daemon's state to the service manager (sd_notify(3)) without waiting.
 *
 * sd_notify() waits while the manager is too busy to read, and a bus must not. Here a message
 * without room is kept and sent later. The last few states are kept in order, and the last status
 * text and watchdog message.
 */
#ifndef CANWIRE_SERVE_NOTIFY_H
#define CANWIRE_SERVE_NOTIFY_H

#include <ev.h>

typedef struct notifier notifier;

/* Opens the notifier. Returns NULL without $NOTIFY_SOCKET, or after logging an error. All functions
 * accept NULL. */
notifier *notify_open(struct ev_loop *loop);

/* Tries once more to send pending messages, and closes the notifier. */
void notify_close(notifier *n);

/* Sends READY=1: started, or finished with reloading, with any result. */
void notify_ready(notifier *n);

/* Sends RELOADING=1 with the time. notify_ready() has to follow. */
void notify_reloading(notifier *n);

/* Sends STOPPING=1. */
void notify_stopping(notifier *n);

/* Sends WATCHDOG=1. */
void notify_alive(notifier *n);

/* Sends STATUS=, a line of at most 1000 bytes. */
void notify_status(notifier *n, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
