/* SPDX-License-Identifier: MIT
 *
 * spans.h - a set of numbers as spans: small when the numbers come in runs, in any order.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_SPANS_H
#define CANWIRE_CAMPAIGN_REPORT_SPANS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct span {
    uint64_t first;
    uint64_t last;
} span;

/* All zeros is the empty set. The spans are in order, and no two of them touch. */
typedef struct spans {
    span *list;
    size_t count;
    size_t room;
} spans;

/* Adds a number. Returns false when it is there already. */
bool spans_add(spans *s, uint64_t number);

void spans_free(spans *s);

#endif
