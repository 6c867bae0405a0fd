/* SPDX-License-Identifier: MIT
 *
 * agenda.c - what each node does next, in the order of moments.
 *
 * All bits have about the same length, so a new entry nearly always belongs near the end of its
 * list.
 */
#include "state/timed.h"

#include <assert.h>
#include <string.h>

static void clear(agenda_list *list)
{
    list->first = list->count = 0;
    list->entries[0].moment = CW_SPAN_MAX;
}

void cw_agenda_clear(cw_agenda *agenda)
{
    clear(&agenda->looks);
    clear(&agenda->others);
}

/* Moves the entries to the front of the array when they have come to its end. */
static void make_room(agenda_list *list)
{
    if (list->first + list->count < 2 * CW_NODES_MAX)
        return;
    assert(list->count < CW_NODES_MAX);
    memmove(list->entries, &list->entries[list->first],
            (list->count + 1) * sizeof list->entries[0]);
    list->first = 0;
}

void cw_agenda_put(cw_agenda *agenda, unsigned node, cw_doing what, cw_span moment)
{
    const agenda_entry entry = {.moment = moment, .what = (uint16_t)((unsigned)what << 8 | node)};
    agenda_list *list = what == CW_LOOKS ? &agenda->looks : &agenda->others;
    make_room(list);
    agenda_entry *first = &list->entries[list->first], *place = first + list->count++;
    place[1].moment = CW_SPAN_MAX;
    for (; place > first && cw_agenda_before(&entry, place - 1); place--)
        *place = place[-1];
    *place = entry;
}

/* Returns the place of a node's entry, behind the last one when it has none. */
static unsigned place_of(const agenda_list *list, unsigned node)
{
    unsigned place = list->first;
    while (place < list->first + list->count && cw_agenda_node(&list->entries[place]) != node)
        place++;
    return place;
}

static bool is_behind(const agenda_list *list, unsigned place)
{
    return place == list->first + list->count;
}

const agenda_entry *cw_agenda_of(const cw_agenda *agenda, unsigned node)
{
    const unsigned look = place_of(&agenda->looks, node);
    const bool other = is_behind(&agenda->looks, look);
    return other ? &agenda->others.entries[place_of(&agenda->others, node)]
                 : &agenda->looks.entries[look];
}

void cw_agenda_remove(cw_agenda *agenda, unsigned node)
{
    agenda_list *list = &agenda->looks;
    unsigned place = place_of(list, node);
    if (is_behind(list, place)) {
        list = &agenda->others;
        place = place_of(list, node);
    }
    assert(!is_behind(list, place));
    const unsigned behind = list->first + list->count - place;
    memmove(&list->entries[place], &list->entries[place + 1], behind * sizeof list->entries[0]);
    list->count--;
}

static void rebase(agenda_list *list, cw_span by)
{
    for (unsigned k = 0; k < list->count; k++)
        list->entries[list->first + k].moment -= by;
}

void cw_agenda_rebase(cw_agenda *agenda, cw_span by)
{
    rebase(&agenda->looks, by);
    rebase(&agenda->others, by);
}

void cw_timed_settle(cw_timed *timed, unsigned i)
{
    timed_node *n = &timed->nodes[i];
    if (!timed->active || !n->ahead)
        return;
    n->ahead = false;
    if (n->next_begin < timed->moment) {
        cw_timed_begin(n);
        return;
    }
    cw_agenda_remove(&timed->agenda, i);
    cw_agenda_put(&timed->agenda, i, CW_BEGINS, n->next_begin);
}
