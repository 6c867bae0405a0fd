/* SPDX-License-Identifier: MIT
 *
 * wants.h - what connections of a CAN_RAW socket ask of their ports.
 */
#ifndef CANWIRE_PRELOAD_WANTS_H
#define CANWIRE_PRELOAD_WANTS_H

#include "preload/conn.h"
#include "preload/table.h"

/* Of a connection that receives. The filters are those of the socket. */
conn_wants wants_all(const cansock *s);

/* Of one that only sends. */
conn_wants wants_sending(const cansock *s);

/* Returns a copy with filters of its own, which wants_free() releases. */
conn_wants wants_copy(const conn_wants *wants);
void wants_free(conn_wants *wants);

#endif
