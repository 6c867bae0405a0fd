/* SPDX-License-Identifier: MIT
 *
 * row.h - reads a row of `canwire campaign run` or of `canwire sim --seeds`.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_ROW_H
#define CANWIRE_CAMPAIGN_REPORT_ROW_H

#include "campaign/space/class.h"

#include <jansson.h>

/* Names of expectations that tell of a detection. */
typedef struct row_signs {
    const char *const *names;
    size_t count;
} row_signs;

/* The texts and values belong to `object`, which report_row_free() frees. */
typedef struct report_row {
    json_t *object;
    bool has_number; /* of a campaign */
    uint64_t number;
    uint64_t seed;
    const json_t *factors; /* an object; NULL without a number */
    const json_t *failed;  /* a list of expectations that are not met; NULL: there is no result */
    const json_t *first_error; /* NULL: there is none */
    const json_t *lost;        /* a list; NULL: there are none */
    const char *repeat;
    class_facts facts;
    row_class class;
    bool has_latency;
    uint64_t latency_ns;
    uint64_t end_ns; /* bus time */
} report_row;

/* Reads a line. Returns NULL, or what is wrong with it; *out is then freed. */
const char *report_row_read(report_row *out, const char *line, size_t length,
                            const row_signs *signs);

void report_row_free(report_row *row);

/* Reads a line as JSON, in which numbers of 19 digits and more may have become texts. Returns NULL
 * for another text. */
json_t *report_row_load(const char *line, size_t length);

/* Returns the name of an expectation in row->failed. */
const char *report_row_failed(const report_row *row, size_t i);

/* Returns true for the name of a sign. */
bool row_signs_has(const row_signs *signs, const char *name);

#endif
