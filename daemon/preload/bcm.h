/* SPDX-License-Identifier: MIT
 *
 * bcm.h - sockets of CAN_BCM: frames that are sent periodically, and changes of received ones.
 */
#ifndef CANWIRE_PRELOAD_BCM_H
#define CANWIRE_PRELOAD_BCM_H

#include "preload/table.h"

#include <sys/socket.h>

/* These return 0 or an errno. */
int bcm_make(cansock *s);
int bcm_connect(cansock *s, const struct sockaddr *address, socklen_t size);
int bcm_send(cansock *s, const void *bytes, size_t size, int index);

/* Ends all jobs. */
void bcm_stop(cansock *s);

void bcm_free(cansock *s);

/* In the child after fork(): the jobs stay with the parent. */
void bcm_forked(void);

#endif
