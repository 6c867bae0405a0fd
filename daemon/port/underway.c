/* SPDX-License-Identifier: MIT
 *
 * underway.c - frames of a port's clients that the bus has taken and has not sent yet.
 */
#include "port/underway.h"

#include <stdlib.h>
#include <string.h>

#define ROOM_FIRST 32u
#define ROOM_MAX 16384u /* more than the longest queue and the inbox hold */
#define COMPARED (CW_FRAME_EXTENDED | CW_FRAME_REMOTE | CW_FRAME_FD | CW_FRAME_BRS)

/* Makes room for one more. */
static bool underway_grow(underway *u)
{
    size_t room = u->room ? 2 * u->room : ROOM_FIRST;
    if (room > ROOM_MAX)
        return false;
    underway_frame *frames = realloc(u->frames, room * sizeof *frames);
    if (!frames)
        return false;
    u->frames = frames;
    u->room = room;
    return true;
}

static void remove_at(underway *u, size_t i)
{
    u->count--;
    memmove(u->frames + i, u->frames + i + 1, (u->count - i) * sizeof *u->frames);
}

bool underway_add(underway *u, const port_frame *frame, uint64_t tick)
{
    const bool room = u->count < u->room || underway_grow(u);
    if (!room && u->count > 0)
        remove_at(u, 0);
    if (u->count < u->room)
        u->frames[u->count++] = (underway_frame){.frame = *frame, .tick = tick};
    return room;
}

/* Compares frames as they were handed in: the controller sets the ESI. */
static bool are_equal(const cw_frame *a, const cw_frame *b)
{
    return a->id == b->id && ((a->flags ^ b->flags) & COMPARED) == 0 && a->dlc == b->dlc &&
           memcmp(a->data, b->data, cw_frame_length(a)) == 0;
}

/* Returns how surely an event is about a frame; 0: it is about another one. A rule may have changed
 * the frame, and a bus that skipped time its hand-in. */
static unsigned likeness(const underway_frame *u, const cw_event *event)
{
    const bool at_hand_in = event->kind == CW_EVENT_DROP;
    const bool same_time = u->tick == (at_hand_in ? event->tick : event->handed_in);
    if (are_equal(&u->frame.frame, &event->frame))
        return same_time ? 3 : 2;
    return same_time && (!at_hand_in || u->frame.frame.id == event->frame.id) ? 1 : 0;
}

bool underway_take(underway *u, port_frame *out, const cw_event *event)
{
    unsigned best = 0;
    size_t found = 0;
    for (size_t i = 0; i < u->count && best < 3; i++) {
        const unsigned like = likeness(&u->frames[i], event);
        if (like <= best)
            continue;
        best = like;
        found = i;
    }
    if (best == 0)
        return false;
    *out = u->frames[found].frame;
    remove_at(u, found);
    return true;
}

bool underway_has(const underway *u, uint32_t client)
{
    for (size_t i = 0; i < u->count; i++)
        if (u->frames[i].frame.client == client)
            return true;
    return false;
}

void underway_free(underway *u)
{
    free(u->frames);
    *u = (underway){.frames = NULL};
}
