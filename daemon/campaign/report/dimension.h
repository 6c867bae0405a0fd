/* SPDX-License-Identifier: MIT
 *
 * dimension.h - the values of a factor that rows have, and the classes of these rows.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_DIMENSION_H
#define CANWIRE_CAMPAIGN_REPORT_DIMENSION_H

#include "campaign/space/class.h"

#include <jansson.h>

#define DIMENSION_VALUES_MAX 65536u /* further ones are counted together */
#define DIMENSION_OTHER UINT32_MAX

/* Rows by their class. */
typedef struct class_counts {
    uint64_t of[CLASS_COUNT];
} class_counts;

typedef struct dimension_value {
    char *text; /* JSON, but strings without quotes */
    class_counts rows;
} dimension_value;

/* All zeros, with a name, has no values. */
typedef struct dimension {
    char *name;
    uint64_t possible; /* 0: not known */
    dimension_value *values; /* in the order of the campaign, or of the rows */
    size_t count;
    size_t room;
    json_t *numbers; /* of the values, by their texts */
    class_counts other; /* of values beyond the limit */
} dimension;

/* Returns the number of a value, which is added when it is new, or DIMENSION_OTHER. */
uint32_t dimension_find(dimension *d, const char *text);

void dimension_count(dimension *d, uint32_t value, row_class class);

/* Returns the number of values that rows have. */
uint64_t dimension_seen(const dimension *d);

/* Returns the rows in the rates, or all of them. */
uint64_t class_counts_rated(const class_counts *c);
uint64_t class_counts_all(const class_counts *c);

/* Returns the rows of both failed classes. */
uint64_t class_counts_failed(const class_counts *c);

void dimension_free(dimension *d);

#endif
