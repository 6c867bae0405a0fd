/* SPDX-License-Identifier: MIT
 *
 * splice.h - puts other values into the text of a configuration, which keeps all else as it is.
 */
#ifndef CANWIRE_CAMPAIGN_SPLICE_H
#define CANWIRE_CAMPAIGN_SPLICE_H

#include "base/schema.h"

#include <stdbool.h>

/* A place in a text. The value stands there between two other texts. */
typedef struct splice_place {
    size_t begin; /* bytes from here ... */
    size_t end;   /* ... to here are replaced */
    const char *before;
    const char *after;
    const char *between; /* two rules of a space */
} splice_place;

/* A text whose document is loaded. */
typedef struct splice_text {
    const char *text;
    size_t size;
    yaml_document_t *document;
    arena *memory;
} splice_text;

/* Finds the place of a value by its path, which is keys with points between. An item of a list is
 * its number in brackets, or the name that it has. The last key need not be there. Returns NULL, or
 * what is wrong. *rule becomes the name of the rule in `faults` that the value is in, or NULL. */
const char *splice_find(splice_place *out, const splice_text *t, const char *path,
                        const char **rule);

/* Finds the place for rules in front of all others; `last` says that no other rules come there.
 * Returns NULL, or what is wrong. */
const char *splice_find_rules(splice_place *out, const splice_text *t, bool first, bool last);

/* Returns the bytes before a character of a text, as libyaml counts characters. */
size_t splice_offset(const char *text, size_t size, size_t character);

#endif
