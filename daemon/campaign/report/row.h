/* SPDX-License-Identifier: MIT
 *
 * row.h - reads a row of `canwire campaign run` or of `canwire sim --seeds`.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_ROW_H
#define CANWIRE_CAMPAIGN_REPORT_ROW_H

#include "base/text/jsonread.h"
#include "campaign/outcome.h"
#include "campaign/space/class.h"

/* Names of expectations that tell of a detection. */
typedef struct row_signs {
    const char *const *names;
    size_t count;
} row_signs;

/* The texts and values belong to the reader and to the line, see jsonread_text(). */
typedef struct report_row {
    const jsonread_value *object;
    bool has_number; /* of a campaign */
    uint64_t number;
    uint64_t seed;
    const jsonread_value *factors; /* an object; NULL without a number */
    const jsonread_value *failed;  /* a list of expectations that are not met; NULL: there is no
                                      result */
    const jsonread_value *first_error; /* NULL: there is none */
    const jsonread_value *lost;        /* a list; NULL: there are none */
    const char *repeat;
    class_facts facts;
    row_class class;
    bool has_latency;
    uint64_t latency_ns;
    uint64_t end_ns; /* bus time */
} report_row;

/* Reads a line. Returns NULL, or what is wrong with it. */
const char *report_row_read(report_row *out, jsonread *reader, const char *line, size_t length,
                            const row_signs *signs);

/* rowcheck.c: returns what is wrong with a row of this outcome, passed or failed, or NULL. */
const char *rowcheck_result(const jsonread_value *row, outcome o);

/* Returns the name of an expectation of row->failed. */
static inline const char *row_failed_name(const jsonread_value *failed)
{
    const char *name = jsonread_string(jsonread_get(failed, "name"));
    return name ? name : "";
}

/* Returns true for the name of a sign. */
bool row_signs_has(const row_signs *signs, const char *name);

#endif
