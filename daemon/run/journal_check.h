/* SPDX-License-Identifier: MIT
 *
 * journal_check.h - checks that a journal is whole, and finds its damages.
 */
#ifndef CANWIRE_RUN_JOURNAL_CHECK_H
#define CANWIRE_RUN_JOURNAL_CHECK_H

#include <stdbool.h>
#include <stdio.h>

/* Reads a journal to its end, without running it. A summary goes to `out`; each problem is a line
 * with its place in `errors`. Returns true when all lines are present and undamaged, and the last
 * one says that canwired has ended. */
bool journal_check(const char *file, FILE *out, FILE *errors);

#endif
