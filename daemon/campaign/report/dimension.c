/* SPDX-License-Identifier: MIT
 *
 * dimension.c - the values of a factor that rows have, and the classes of these rows.
 */
#include "campaign/report/dimension.h"

#include "base/text/jsonput.h"
#include "campaign/report/memory.h"

#include <stdlib.h>

uint32_t dimension_find(dimension *d, const char *text)
{
    const json_t *number = json_object_get(d->numbers, text);
    if (number)
        return (uint32_t)json_integer_value(number);
    if (d->count >= DIMENSION_VALUES_MAX)
        return DIMENSION_OTHER;
    if (!d->numbers)
        d->numbers = json_object();
    put(d->numbers, text, json_integer((json_int_t)d->count));
    d->values = memory_grow(d->values, &d->room, d->count, sizeof *d->values);
    d->values[d->count] = (dimension_value){.text = memory_text(text)};
    return (uint32_t)d->count++;
}

void dimension_count(dimension *d, uint32_t value, row_class class)
{
    class_counts *c = value == DIMENSION_OTHER ? &d->other : &d->values[value].rows;
    c->of[class]++;
}

uint64_t dimension_seen(const dimension *d)
{
    uint64_t seen = 0;
    for (size_t i = 0; i < d->count; i++)
        seen += class_counts_all(&d->values[i].rows) > 0;
    return seen;
}

uint64_t class_counts_rated(const class_counts *c)
{
    uint64_t sum = 0;
    for (unsigned i = 0; i < CLASS_RATED; i++)
        sum += c->of[i];
    return sum;
}

uint64_t class_counts_all(const class_counts *c)
{
    uint64_t sum = 0;
    for (unsigned i = 0; i < CLASS_COUNT; i++)
        sum += c->of[i];
    return sum;
}

uint64_t class_counts_failed(const class_counts *c)
{
    return c->of[CLASS_DETECTED] + c->of[CLASS_UNDETECTED];
}

void dimension_free(dimension *d)
{
    for (size_t i = 0; i < d->count; i++)
        free(d->values[i].text);
    free(d->values);
    free(d->name);
    json_decref(d->numbers);
    *d = (dimension){.name = NULL};
}
