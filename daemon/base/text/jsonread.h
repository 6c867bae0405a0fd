/* SPDX-License-Identifier: MIT
 *
 * jsonread.h - reads many JSON texts in the same memory, much faster than jansson does.
 *
 * It takes the texts that jansson takes with JSON_REJECT_DUPLICATES. Whole numbers may also have 64
 * bits without a sign. The values of a text are a list in which all that is in a list or an object
 * follows it.
 */
#ifndef CANWIRE_BASE_JSONREAD_H
#define CANWIRE_BASE_JSONREAD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

typedef enum jsonread_kind {
    JSONREAD_NULL = 0,
    JSONREAD_FALSE,
    JSONREAD_TRUE,
    JSONREAD_INTEGER,
    JSONREAD_REAL, /* with a point or an exponent */
    JSONREAD_STRING,
    JSONREAD_LIST,
    JSONREAD_OBJECT
} jsonread_kind;

typedef struct jsonread_value {
    jsonread_kind kind;
    uint32_t span;       /* values, with all that is in it */
    const char *key;     /* of a member, with a final 0; NULL: it is an item, or all of the text */
    size_t key_length;
    const char *text;    /* a string without escapes, with a final 0; all else as it is written */
    size_t length;
} jsonread_value;

typedef enum jsonread_problem {
    JSONREAD_GOOD = 0,
    JSONREAD_NO_JSON,
    JSONREAD_TWICE, /* a key is there twice */
    JSONREAD_NO_MEMORY
} jsonread_problem;

/* All zeros has no memory yet. */
typedef struct jsonread {
    char *copy; /* of the text, in which strings lose their escapes */
    size_t room;
    jsonread_value *values;
    size_t value_room;
    size_t value_count;
} jsonread;

/* Reads a text. Returns its value, or NULL with a problem. The value is valid until the next call,
 * and as long as the text is. */
const jsonread_value *jsonread_text(jsonread *r, jsonread_problem *problem, const char *text,
                                    size_t length);

void jsonread_free(jsonread *r);

/* Returns the first item or member; NULL: there is none. A value that is NULL has none. */
static inline const jsonread_value *jsonread_first(const jsonread_value *all)
{
    return all && all->span > 1 ? all + 1 : NULL;
}

/* Returns the one behind an item or member; NULL: it is the last one. */
static inline const jsonread_value *jsonread_next(const jsonread_value *all,
                                                  const jsonread_value *one)
{
    const jsonread_value *next = one + one->span;
    return next < all + all->span ? next : NULL;
}

static inline bool jsonread_is(const jsonread_value *v, jsonread_kind kind)
{
    return v && v->kind == kind;
}

/* Returns a member of an object; NULL: it has none, or is not an object. A key that stands behind
 * `last` is found at once; NULL: any may come first. */
const jsonread_value *jsonread_find(const jsonread_value *object, const jsonread_value *last,
                                    const char *key, size_t length);

static inline const jsonread_value *jsonread_get(const jsonread_value *object, const char *key)
{
    return jsonread_find(object, NULL, key, strlen(key));
}

/* Returns a string; NULL: it is another value. */
static inline const char *jsonread_string(const jsonread_value *v)
{
    return jsonread_is(v, JSONREAD_STRING) ? v->text : NULL;
}

/* Reads a whole number of up to 64 bits. Returns false for one below 0 or another value. */
bool jsonread_uint(uint64_t *out, const jsonread_value *v);

/* Returns a number; 0 for another value. */
double jsonread_number(const jsonread_value *v);

/* Returns true for values that say the same, whatever the order of members. */
bool jsonread_equals(const jsonread_value *a, const jsonread_value *b);

#endif
