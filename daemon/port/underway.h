/* SPDX-License-Identifier: MIT
 *
 * underway.h - frames of a port's clients that the bus has taken and has not sent yet.
 *
 * The bus does not know clients. A frame that it has sent, or dropped, is found again here: by its
 * bits and the time of its hand-in. Equal frames of a node leave in the order in which they came.
 */
#ifndef CANWIRE_PORT_UNDERWAY_H
#define CANWIRE_PORT_UNDERWAY_H

#include "port/port.h"

typedef struct underway_frame {
    port_frame frame;
    uint64_t tick; /* of its hand-in */
} underway_frame;

typedef struct underway {
    underway_frame *frames; /* in the order of their hand-in */
    size_t count;
    size_t room;
} underway;

/* Adds a frame. Returns false when the oldest had to make room for it, or there is no memory. */
bool underway_add(underway *u, const port_frame *frame, uint64_t tick);

/* Takes the frame that an event is about (CW_EVENT_TX, CW_EVENT_DROP). Returns false when it is not
 * one of them: rules make frames, too. */
bool underway_take(underway *u, port_frame *out, const cw_event *event);

/* Returns true when a frame of a client is among them. */
bool underway_has(const underway *u, uint32_t client);

void underway_free(underway *u);

#endif
