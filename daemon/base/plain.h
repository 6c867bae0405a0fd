/* SPDX-License-Identifier: MIT
 *
 * plain.h - text of others, before it is shown: on one line, nothing in it that a terminal obeys.
 */
#ifndef CANWIRE_BASE_PLAIN_H
#define CANWIRE_BASE_PLAIN_H

#include <stdbool.h>
#include <stdio.h>

/* Puts a character in the place of each control character: those below a space, DEL, and C1 (U+0080
 * to U+009F, as UTF-8 or as single bytes), and of each byte that is no UTF-8. */
void plain_make(char *text, char instead);

/* Whether a text has one of these, other than tabs and ends of lines. */
bool plain_is_not(const char *text);

/* The names of options among the words of a command line: getopt() prints unknown ones as they are.
 * What follows a '=' stays. */
void plain_options(int argc, char **argv);

/* As fprintf(), with '?' for each of these but for tabs and ends of lines; cut at 16 KB. */
void plain_print(FILE *out, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
