/* SPDX-License-Identifier: MIT
 *
 * crosstab.c - the classes of rows, for each pair of values that two factors have in them.
 */
#include "campaign/report/crosstab.h"

#include "campaign/report/memory.h"

#include <stdlib.h>
#include <string.h>

#define SLOTS_FIRST 64u

/* ---- The hash table -------------------------------------------------------------------------- */

/* Mixes both numbers: the factor is that of Fibonacci hashing, 2^64 by the golden ratio. */
static size_t hash_of(uint32_t first, uint32_t second)
{
    const uint64_t both = (uint64_t)first << 32 | second;
    const uint64_t product = both * UINT64_C(0x9E3779B97F4A7C15);
    return (size_t)(product >> 32 ^ product >> 48);
}

/* Returns the slot of a pair, or the free one where it belongs. Half of them are free. */
static uint32_t *slot_of(const crosstab *t, uint32_t first, uint32_t second)
{
    const size_t mask = t->slot_count - 1;
    size_t at = hash_of(first, second) & mask;
    for (; t->slots[at] > 0; at = (at + 1) & mask) {
        const crosstab_cell *c = &t->cells[t->slots[at] - 1];
        if (c->first == first && c->second == second)
            break;
    }
    return &t->slots[at];
}

/* Doubles the slots when the next cell would fill half of them. */
static void crosstab_grow(crosstab *t)
{
    if (2 * (t->count + 1) < t->slot_count)
        return;
    t->slot_count = t->slot_count > 0 ? 2 * t->slot_count : SLOTS_FIRST;
    t->slots = memory_list(t->slots, t->slot_count, sizeof *t->slots);
    memset(t->slots, 0, t->slot_count * sizeof *t->slots);
    for (size_t i = 0; i < t->count; i++)
        *slot_of(t, t->cells[i].first, t->cells[i].second) = (uint32_t)i + 1;
}

/* ---- Cells ----------------------------------------------------------------------------------- */

class_counts *crosstab_find(const crosstab *t, uint32_t first, uint32_t second)
{
    const uint32_t number = t->slot_count > 0 ? *slot_of(t, first, second) : 0;
    return number > 0 ? &t->cells[number - 1].rows : NULL;
}

class_counts *crosstab_add(crosstab *t, uint32_t first, uint32_t second)
{
    crosstab_grow(t);
    t->cells = memory_grow(t->cells, &t->room, t->count, sizeof *t->cells);
    t->cells[t->count] = (crosstab_cell){.first = first, .second = second};
    *slot_of(t, first, second) = (uint32_t)t->count + 1;
    return &t->cells[t->count++].rows;
}

/* Orders cells by their first value, then by their second. */
static int crosstab_compare(const void *left, const void *right)
{
    const crosstab_cell *a = *(const crosstab_cell *const *)left;
    const crosstab_cell *b = *(const crosstab_cell *const *)right;
    if (a->first != b->first)
        return a->first < b->first ? -1 : 1;
    return a->second < b->second ? -1 : a->second > b->second;
}

const crosstab_cell **crosstab_sorted(const crosstab *t)
{
    const crosstab_cell **list = memory_list(NULL, t->count, sizeof *list);
    for (size_t i = 0; i < t->count; i++)
        list[i] = &t->cells[i];
    qsort(list, t->count, sizeof *list, crosstab_compare);
    return list;
}

void crosstab_free(crosstab *t)
{
    free(t->cells);
    free(t->slots);
    *t = (crosstab){.cells = NULL};
}
