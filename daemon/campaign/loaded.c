/* SPDX-License-Identifier: MIT
 *
 * loaded.c - scenarios that are loaded, by the values that they were loaded with.
 */
#include "campaign/loaded.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

static bool loaded_is_same(const buffer *a, const buffer *b)
{
    const size_t length = buffer_length(a);
    return !a->no_memory && !b->no_memory && length == buffer_length(b) &&
           (length == 0 || memcmp(buffer_first(a), buffer_first(b), length) == 0);
}

loaded *loaded_find(loaded_list *list, const buffer *key)
{
    for (size_t i = 0; i < list->room; i++) {
        loaded *l = &list->places[i];
        if (!l->scenario || !loaded_is_same(&l->key, key))
            continue;
        l->used = ++list->uses;
        return l;
    }
    return NULL;
}

/* Frees what a place holds. With use 0 it is the next one to be taken. */
static void empty(loaded *l)
{
    for (size_t i = 0; i < l->slot_count; i++)
        rule_slot_free(&l->slots[i]);
    free(l->slots);
    scenario_close(l->scenario);
    buffer_free(&l->key);
    *l = (loaded){.scenario = NULL};
}

/* Returns an empty place, or the one that was used least recently. An empty one has the use 0. */
static loaded *loaded_find_place(loaded_list *list)
{
    loaded *found = &list->places[0];
    for (size_t i = 1; i < list->room; i++)
        if (list->places[i].used < found->used)
            found = &list->places[i];
    return found;
}

/* The place has slots of its own: the rules that they get belong to its scenario. */
static bool copy_slots(loaded *l, const rule_slot *slots, size_t count)
{
    l->slots = count > 0 ? malloc(count * sizeof *slots) : NULL;
    if (count > 0 && !l->slots)
        return false;
    if (count > 0)
        memcpy(l->slots, slots, count * sizeof *slots);
    l->slot_count = count;
    return true;
}

loaded *loaded_keep(loaded_list *list, scenario *s, const buffer *key, const rule_slot *slots,
                    size_t slot_count)
{
    assert(list->room > 0 && list->room <= LOADED_MAX);
    loaded *l = loaded_find_place(list);
    empty(l);
    l->scenario = s;
    l->used = ++list->uses;
    if (copy_slots(l, slots, slot_count) &&
        buffer_append(&l->key, buffer_first(key), buffer_length(key)))
        return l;
    empty(l);
    return NULL;
}

void loaded_clear(loaded_list *list)
{
    for (size_t i = 0; i < list->room; i++)
        empty(&list->places[i]);
}
