/* SPDX-License-Identifier: MIT
 *
 * journal_check.h - whether a journal is whole, and where it is not.
 */
#ifndef CANWIRE_RUN_JOURNAL_CHECK_H
#define CANWIRE_RUN_JOURNAL_CHECK_H

#include <stdbool.h>
#include <stdio.h>

/* Reads a journal to its end, without running it. What is in it goes to out, what is wrong to
 * errors, a line each with its place. Whether nothing is wrong: all lines are there and as they
 * were written, nothing is missing, and the last one says that canwired has ended. */
bool journal_check(const char *file, FILE *out, FILE *errors);

#endif
