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

/* Empties a list. The place behind the last entry has a moment that never comes. */
static void agenda_clear(cw_agenda_list *list)
{
    list->first = list->behind = list->entries;
    list->behind->moment = CW_SPAN_MAX;
}

void cw_agenda_clear(cw_agenda *agenda)
{
    agenda_clear(&agenda->looks);
    agenda_clear(&agenda->others);
}

void cw_agenda_make_room(cw_agenda_list *list)
{
    const size_t count = (size_t)(list->behind - list->first);
    assert(count < CW_NODES_MAX);
    memmove(list->entries, list->first, (count + 1) * sizeof list->entries[0]);
    list->first = list->entries;
    list->behind = list->entries + count;
}

/* Returns the entry of a node, the place behind the last one when it has none. */
static const cw_agenda_entry *entry_of(const cw_agenda_list *list, unsigned node)
{
    const cw_agenda_entry *e = list->first;
    while (e < list->behind && cw_agenda_node(e) != node)
        e++;
    return e;
}

const cw_agenda_entry *cw_agenda_of(const cw_agenda *agenda, unsigned node)
{
    const cw_agenda_entry *look = entry_of(&agenda->looks, node);
    return look < agenda->looks.behind ? look : entry_of(&agenda->others, node);
}

void cw_agenda_remove(cw_agenda *agenda, unsigned node)
{
    const cw_agenda_entry *entry = cw_agenda_of(agenda, node);
    cw_agenda_list *list = cw_agenda_what(entry) == CW_LOOKS ? &agenda->looks : &agenda->others;
    assert(entry < list->behind);
    cw_agenda_entry *place = list->first + (entry - list->first);
    memmove(place, place + 1, (size_t)(list->behind - place) * sizeof *place);
    list->behind--;
}

/* Moves all entries back, since moments count from a later one now. */
static void rebase(cw_agenda_list *list, cw_span by)
{
    for (cw_agenda_entry *e = list->first; e < list->behind; e++)
        e->moment -= by;
}

void cw_agenda_rebase(cw_agenda *agenda, cw_span by)
{
    rebase(&agenda->looks, by);
    rebase(&agenda->others, by);
}

void cw_timed_settle(cw_timed *timed, unsigned i)
{
    cw_timed_node *n = &timed->nodes[i];
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
