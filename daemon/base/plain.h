/* SPDX-License-Identifier: MIT
 *
 * plain.h - makes foreign text safe to show: on one line, without control characters.
 */
#ifndef CANWIRE_BASE_PLAIN_H
#define CANWIRE_BASE_PLAIN_H

#include <stdbool.h>
#include <stdio.h>

/* Replaces each control character, and each byte that is no UTF-8, by another character. Control
 * characters are those below a space, DEL, and C1 (U+0080 to U+009F, as UTF-8 or as single
 * bytes). */
void plain_make(char *text, char instead);

/* Returns true when a text has such a character, other than tabs and ends of lines. */
bool plain_is_not(const char *text);

/* Makes the names of options on a command line safe: getopt() prints unknown ones unchanged. Text
 * after a '=' stays. */
void plain_options(int argc, char **argv);

/* Prints as fprintf() does, with '?' for each such character but tabs and ends of lines. Cuts the
 * text at 16 KB. */
void plain_print(FILE *out, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
