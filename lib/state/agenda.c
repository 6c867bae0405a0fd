/* SPDX-License-Identifier: MIT
 *
 * agenda.c - what each node does next, in the order of moments.
 *
 * All bits have about the same length, so a new entry nearly always belongs near the end.
 */
#include "state/timed.h"

#include <assert.h>
#include <string.h>

void cw_agenda_clear(cw_agenda *agenda)
{
    agenda->first = agenda->count = 0;
}

static inline bool comes_before(const agenda_entry *a, const agenda_entry *b)
{
    return a->moment != b->moment ? a->moment < b->moment : a->what < b->what;
}

/* Moves the entries to the front of the array when they have come to its end. */
static void make_room(cw_agenda *agenda)
{
    if (agenda->first + agenda->count < 2 * CW_NODES_MAX)
        return;
    memmove(agenda->entries, &agenda->entries[agenda->first],
            agenda->count * sizeof agenda->entries[0]);
    agenda->first = 0;
}

void cw_agenda_put(cw_agenda *agenda, unsigned node, cw_doing what, cw_span moment)
{
    const agenda_entry entry = {.moment = moment, .what = (uint16_t)((unsigned)what << 8 | node)};
    assert(agenda->count < CW_NODES_MAX);
    make_room(agenda);
    agenda_entry *place = &agenda->entries[agenda->first + agenda->count++];
    for (; place > &agenda->entries[agenda->first] && comes_before(&entry, place - 1); place--)
        *place = place[-1];
    *place = entry;
}

static unsigned place_of(const cw_agenda *agenda, unsigned node)
{
    unsigned place = agenda->first;
    while (cw_agenda_node(&agenda->entries[place]) != node)
        place++;
    assert(place < agenda->first + agenda->count);
    return place;
}

const agenda_entry *cw_agenda_of(const cw_agenda *agenda, unsigned node)
{
    return &agenda->entries[place_of(agenda, node)];
}

void cw_agenda_remove(cw_agenda *agenda, unsigned node)
{
    const unsigned place = place_of(agenda, node);
    const unsigned behind = agenda->first + agenda->count - 1 - place;
    memmove(&agenda->entries[place], &agenda->entries[place + 1],
            behind * sizeof agenda->entries[0]);
    agenda->count--;
}

void cw_agenda_rebase(cw_agenda *agenda, cw_span by)
{
    for (unsigned i = 0; i < agenda->count; i++)
        agenda->entries[agenda->first + i].moment -= by;
}
