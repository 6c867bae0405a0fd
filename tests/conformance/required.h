/* SPDX-License-Identifier: MIT
 *
 * required.h - the cases that must be there, one table for each kind of node and frames.
 */
#ifndef REQUIRED_H
#define REQUIRED_H

#include "bench.h"

typedef struct requirement {
    const char *number;
    unsigned count; /* of elementary tests, in all passes of the table; at least */
} requirement;

typedef struct required_table {
    const char *title;  /* NULL: the first one */
    const char *passes; /* letters (pass) */
    const requirement *rows;
    size_t count;
} required_table;

extern const required_table required_tables[];
extern const unsigned required_table_count;

#endif
