/* SPDX-License-Identifier: MIT
 *
 * spans.c - a set of numbers as spans: small when the numbers come in runs, in any order.
 */
#include "campaign/report/spans.h"

#include "campaign/report/memory.h"

#include <stdlib.h>
#include <string.h>

/* Returns the number of spans that begin at or before a number. */
static size_t spans_find(const spans *s, uint64_t number)
{
    size_t low = 0;
    size_t high = s->count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (s->list[middle].first <= number)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Inserts a span of one number before place `at`. Neighbours are joined by the caller. */
static void spans_insert(spans *s, size_t at, uint64_t number)
{
    s->list = memory_grow(s->list, &s->room, s->count, sizeof *s->list);
    memmove(s->list + at + 1, s->list + at, (s->count - at) * sizeof *s->list);
    s->list[at] = (span){.first = number, .last = number};
    s->count++;
}

/* Joins a span with the next one. */
static void spans_join(spans *s, size_t at)
{
    s->list[at].last = s->list[at + 1].last;
    memmove(s->list + at + 1, s->list + at + 2, (s->count - at - 2) * sizeof *s->list);
    s->count--;
}

bool spans_add(spans *s, uint64_t number)
{
    const size_t at = spans_find(s, number);
    span *before = at > 0 ? &s->list[at - 1] : NULL;
    span *after = at < s->count ? &s->list[at] : NULL;
    if (before && number <= before->last)
        return false;
    const bool extends = before && before->last + 1 == number;
    const bool precedes = after && after->first == number + 1;
    if (extends)
        before->last = number;
    else if (precedes)
        after->first = number;
    else
        spans_insert(s, at, number);
    if (extends && precedes)
        spans_join(s, at - 1);
    return true;
}

void spans_free(spans *s)
{
    free(s->list);
    *s = (spans){.count = 0};
}
