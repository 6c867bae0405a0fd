/* SPDX-License-Identifier: MIT
 *
 * plain.h - text of others, before it is shown: on one line, nothing in it that a terminal obeys.
 */
#ifndef CANWIRE_BASE_PLAIN_H
#define CANWIRE_BASE_PLAIN_H

/* Puts a character in the place of each control character: those below a space, DEL, and C1 (U+0080
 * to U+009F, as UTF-8 or as single bytes), and of each byte that is no UTF-8. */
void plain_make(char *text, char instead);

#endif
