/* SPDX-License-Identifier: MIT
 *
 * plain.h - makes foreign text safe to show: on one line, without control characters.
 */
#ifndef CANWIRE_BASE_PLAIN_H
#define CANWIRE_BASE_PLAIN_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/* Reads the character that begins here. Returns its bytes, 0: it is not UTF-8. */
size_t plain_character(uint32_t *code, const char *text);

/* Returns the bytes of the character that begins here. Returns 0 for a byte that is not UTF-8, and
 * for the first one of a character that is not seen as itself. Such are control characters: below a
 * space, DEL, and C1 (U+0080 to U+009F). Such are also those that change or hide what is around
 * them: marks of direction, ends of paragraphs, characters without width. */
size_t plain_size(const char *text);

/* Replaces each byte of such characters by another character. */
void plain_make(char *text, char instead);

/* Does the same, but tabs and ends of lines stay. */
void plain_make_lines(char *text, char instead);

/* Returns true when a text has control characters, other than tabs and ends of lines, or bytes that
 * are not UTF-8. */
bool plain_is_not(const char *text);

/* Makes the names of options on a command line safe: getopt() prints unknown ones unchanged. Text
 * after a '=' stays. */
void plain_options(int argc, char **argv);

/* Prints as fprintf() does, with '?' for each such character but tabs and ends of lines. Cuts the
 * text at 16 KB. */
void plain_print(FILE *out, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
