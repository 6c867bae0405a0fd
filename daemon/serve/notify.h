/* SPDX-License-Identifier: MIT
 *
 * notify.h - tells the service manager how the daemon is (sd_notify(3)), without waiting for it.
 *
 * sd_notify() waits while the manager is too busy to read, and a bus must not. Here a message for
 * which there is no room is kept and tried again: of the states the last few in their order, of
 * status texts and signs of life the last one.
 */
#ifndef CANWIRE_SERVE_NOTIFY_H
#define CANWIRE_SERVE_NOTIFY_H

#include <ev.h>

typedef struct notifier notifier;

/* NULL when nobody wants to be told (no $NOTIFY_SOCKET), or it cannot be done, which is logged.
 * All functions take NULL. */
notifier *notify_open(struct ev_loop *loop);

/* Tries once more to send what is left. */
void notify_close(notifier *n);

/* READY=1: started, or done with reloading, in any way. */
void notify_ready(notifier *n);

/* RELOADING=1, with the time. notify_ready() has to follow. */
void notify_reloading(notifier *n);

/* STOPPING=1 */
void notify_stopping(notifier *n);

/* WATCHDOG=1 */
void notify_alive(notifier *n);

/* STATUS=, a line of at most 1000 bytes. */
void notify_status(notifier *n, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
