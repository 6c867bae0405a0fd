/* SPDX-License-Identifier: MIT
 *
 * watch.h - the epoll sets in which a program has put a CAN socket.
 *
 * The kernel takes a descriptor out of them when another socket is put under it. All functions need
 * the lock of the table.
 */
#ifndef CANWIRE_PRELOAD_WATCH_H
#define CANWIRE_PRELOAD_WATCH_H

#include <stdbool.h>
#include <sys/epoll.h>

typedef struct watch watch;

/* Notes a call of epoll_ctl() that was successful. */
void watch_note(watch **first, int set, int operation, int fd, const struct epoll_event *event);

/* Takes a descriptor out of its sets, before it gets another socket, and puts it in again. */
void watch_suspend(watch *first, int fd);
void watch_resume(watch *first, int fd);

/* Forgets the sets of a descriptor. */
void watch_forget(watch **first, int fd);

#endif
