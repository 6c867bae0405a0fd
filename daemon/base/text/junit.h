/* SPDX-License-Identifier: MIT
 *
 * junit.h - test results as JUnit XML, for Jenkins and others.
 */
#ifndef CANWIRE_BASE_JUNIT_H
#define CANWIRE_BASE_JUNIT_H

#include <stdint.h>
#include <stdio.h>

#define JUNIT_NO_TIME UINT64_MAX

typedef struct junit_counts {
    uint64_t cases;
    uint64_t failures;
    uint64_t errors;
} junit_counts;

/* A test case. It is good without `problem`, which is "failure" or "error". */
typedef struct junit_case {
    const char *name;
    const char *suite;
    uint64_t ticks; /* of bus time, or JUNIT_NO_TIME */
    const char *problem;
    const char *type;    /* of the problem */
    const char *message; /* the same */
} junit_case;

/* Begins the file; counts of all cases may be NULL. */
void junit_begin(FILE *out, const char *name, const junit_counts *counts, uint64_t ticks);

/* Begins a suite, the parent of the cases that follow. */
void junit_begin_suite(FILE *out, const char *name, const junit_counts *counts, uint64_t ticks);

void junit_write_case(FILE *out, const junit_case *one);

void junit_end_suite(FILE *out);
void junit_end(FILE *out);

#endif
