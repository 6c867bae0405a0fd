/* SPDX-License-Identifier: MIT
 *
 * list.c - sorted lists of rules, by their index.
 */
#include "rule/list.h"

#include <string.h>

/* Returns the place where a rule stands, or would stand, in a sorted list. */
static unsigned list_find(const uint16_t *list, unsigned count, unsigned rule)
{
    unsigned place = 0;
    while (place < count && list[place] < rule)
        place++;
    return place;
}

void cw_list_add(uint16_t *list, unsigned *count, unsigned rule)
{
    unsigned place = list_find(list, *count, rule);
    memmove(&list[place + 1], &list[place], (*count - place) * sizeof list[0]);
    list[place] = (uint16_t)rule;
    (*count)++;
}

void cw_list_remove(uint16_t *list, unsigned *count, unsigned rule)
{
    unsigned place = list_find(list, *count, rule);
    if (place == *count || list[place] != rule)
        return;
    (*count)--;
    memmove(&list[place], &list[place + 1], (*count - place) * sizeof list[0]);
}
