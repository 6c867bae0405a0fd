/* SPDX-License-Identifier: MIT
 *
 * sametext.h - compares texts that may be missing.
 */
#ifndef CANWIRE_BASE_SAMETEXT_H
#define CANWIRE_BASE_SAMETEXT_H

#include <stdbool.h>
#include <string.h>

/* NULL is the same as NULL alone, not as "". */
static inline bool same_text(const char *a, const char *b)
{
    return a == b || (a && b && strcmp(a, b) == 0);
}

#endif
