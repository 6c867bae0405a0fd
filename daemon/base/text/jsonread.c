/* SPDX-License-Identifier: MIT
 *
 * jsonread.c - reads many JSON texts in the same memory, much faster than jansson does.
 */
#include "base/text/jsonread.h"

#include "base/text/chars.h"
#include "base/text/number.h"
#include "base/text/plain.h"

#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdlib.h>

#define DEPTH_MAX 2048u /* of lists and objects in each other, as with jansson */
#define NO_PARENT UINT32_MAX
#define VALUES_FIRST 64u
#define SIGNED_DIGITS 19u /* of 2^63; fewer fit in any case */

/* A text that is being read. The span of a value that is open is the place of its parent, and its
 * length is the set of hashes of its keys. */
typedef struct reading {
    jsonread *r;
    char *at;           /* in the copy, which ends with a 0 */
    const char *text;   /* the original */
    size_t length;
    uint32_t parent;    /* that is open */
    unsigned depth;
    const char *key;    /* of the next value */
    size_t key_length;
    jsonread_problem problem;
} reading;

static bool is_digit(char c)
{
    return c >= '0' && c <= '9';
}

static inline void skip_blanks(reading *p)
{
    while (*p->at == ' ' || *p->at == '\n' || *p->at == '\r' || *p->at == '\t')
        p->at++;
}

static bool fail(reading *p, jsonread_problem problem)
{
    p->problem = problem;
    return false;
}

/* ---- Strings --------------------------------------------------------------------------------- */

/* Reads the four digits of \uXXXX. Returns false for others. */
static bool take_unit(reading *p, uint32_t *unit)
{
    if (!text_parse_hex(unit, p->at, 4))
        return false;
    p->at += 4;
    return true;
}

/* Writes a character as UTF-8. Returns the end. */
static char *put_character(char *out, uint32_t code)
{
    const unsigned more = code < 0x80 ? 0 : code < 0x800 ? 1 : code < 0x10000 ? 2 : 3;
    static const uint8_t first[] = {0, 0xC0, 0xE0, 0xF0};
    *out++ = (char)(first[more] | code >> 6 * more);
    for (unsigned i = more; i > 0; i--)
        *out++ = (char)(0x80 | (code >> 6 * (i - 1) & 0x3F));
    return out;
}

/* Reads what follows \u: a character, or two halves of one. No text has a 0. */
static bool take_unicode(reading *p, uint32_t *code)
{
    uint32_t low;
    if (!take_unit(p, code) || *code == 0 || (*code >= 0xDC00 && *code <= 0xDFFF))
        return false;
    if (*code < 0xD800 || *code > 0xDBFF)
        return true;
    if (p->at[0] != '\\' || p->at[1] != 'u')
        return false;
    p->at += 2;
    if (!take_unit(p, &low) || low < 0xDC00 || low > 0xDFFF)
        return false;
    *code = 0x10000 + ((*code & 0x3FF) << 10 | (low & 0x3FF));
    return true;
}

/* Reads what follows a backslash. Returns the end of what is written; NULL: it is not an escape. */
static char *take_escape(reading *p, char *out)
{
    static const char from[] = "\"\\/bfnrt", to[] = "\"\\/\b\f\n\r\t";
    uint32_t code;
    const char c = *p->at++;
    if (c == 'u')
        return take_unicode(p, &code) ? put_character(out, code) : NULL;
    const char *found = c ? strchr(from, c) : NULL;
    if (!found)
        return NULL;
    *out++ = to[found - from];
    return out;
}

/* Copies a character that is not ASCII. Returns the end of what is written; NULL: it is not
 * UTF-8. */
static char *take_other(reading *p, char *out)
{
    static const uint32_t least[] = {0, 0, 0x80, 0x800, 0x10000};
    uint32_t code;
    const size_t size = plain_character(&code, p->at);
    if (size < 2 || code < least[size] || code > 0x10FFFF || (code >= 0xD800 && code <= 0xDFFF))
        return NULL;
    memmove(out, p->at, size);
    p->at += size;
    return out + size;
}

/* Reads the rest of a string, of which the characters up to `out` stand for themselves. Returns its
 * end, or NULL. */
static char *take_rest(reading *p, char *out)
{
    while (*p->at != '"') {
        if (chars_plain[(unsigned char)*p->at])
            *out++ = *p->at++;
        else if (*p->at == '\\' && p->at++)
            out = take_escape(p, out);
        else
            out = (unsigned char)*p->at >= 0x80 ? take_other(p, out) : NULL;
        if (!out)
            return NULL;
    }
    p->at++;
    return out;
}

/* Reads a string behind its first quote. It loses its escapes and gets a final 0 in its place. */
static bool take_string(reading *p, const char **text, size_t *length)
{
    char *const begin = p->at;
    char *end = begin;
    while (chars_plain[(unsigned char)*end])
        end++;
    p->at = end;
    if (*end == '"')
        p->at++;
    else
        end = take_rest(p, end);
    if (!end)
        return fail(p, JSONREAD_NO_JSON);
    *end = '\0';
    *text = begin;
    *length = (size_t)(end - begin);
    return true;
}

/* ---- Values ---------------------------------------------------------------------------------- */

/* Makes room for a value. Returns false without memory. */
static bool jsonread_reserve(jsonread *r)
{
    if (r->value_count < r->value_room)
        return true;
    const size_t room = r->value_room > 0 ? 2 * r->value_room : VALUES_FIRST;
    jsonread_value *values = room < UINT32_MAX ? reallocarray(r->values, room, sizeof *values)
                                               : NULL;
    if (!values)
        return false;
    r->values = values;
    r->value_room = room;
    return true;
}

/* Adds a value with the key that has been read. */
static bool jsonread_add(reading *p, jsonread_kind kind, const char *text, size_t length)
{
    jsonread *r = p->r;
    if (!jsonread_reserve(r))
        return fail(p, JSONREAD_NO_MEMORY);
    r->values[r->value_count++] = (jsonread_value){.kind = kind, .span = 1, .key = p->key,
                                                   .key_length = p->key_length, .text = text,
                                                   .length = length};
    return true;
}

/* Takes true, false or null. */
static bool take_word(reading *p, jsonread_kind kind, const char *word)
{
    const size_t length = strlen(word);
    const char *const begin = p->at;
    if (strncmp(begin, word, length) != 0)
        return fail(p, JSONREAD_NO_JSON);
    p->at += length;
    return jsonread_add(p, kind, begin, length);
}

/* Passes over digits. Returns false when there is none. */
static bool pass_digits(reading *p)
{
    const bool any = is_digit(*p->at);
    while (is_digit(*p->at))
        p->at++;
    return any;
}

/* Passes over a fraction and an exponent. Returns false where digits are missing. */
static bool pass_fraction(reading *p)
{
    if (*p->at == '.') {
        p->at++;
        if (!pass_digits(p))
            return false;
    }
    if (*p->at != 'e' && *p->at != 'E')
        return true;
    p->at++;
    p->at += *p->at == '+' || *p->at == '-';
    return pass_digits(p);
}

/* Returns true when a whole number has 64 bits: without a sign, or with one. */
static bool fits(const char *number, size_t length)
{
    uint64_t value;
    const bool negative = *number == '-';
    if (length < SIGNED_DIGITS)
        return true;
    number += negative;
    return text_take_digits(&value, &number, negative ? UINT64_C(1) << 63 : UINT64_MAX);
}

/* Returns true when a number with a point or an exponent is in reach of a double. */
static bool is_in_reach(const char *number, size_t length)
{
    const bool long_or_exponent =
        length > DBL_MAX_10_EXP || memchr(number, 'e', length) || memchr(number, 'E', length);
    return !long_or_exponent || isfinite(strtod(number, NULL));
}

/* Reads a number by the grammar of JSON: no leading zeros, no lone point. */
static bool take_number(reading *p)
{
    const char *const begin = p->at;
    p->at += *begin == '-';
    const bool zero = *p->at == '0';
    if (zero ? (p->at++, is_digit(*p->at)) : !pass_digits(p))
        return fail(p, JSONREAD_NO_JSON);
    const char *const whole = p->at;
    if (!pass_fraction(p))
        return fail(p, JSONREAD_NO_JSON);
    const size_t length = (size_t)(p->at - begin);
    const bool real = p->at > whole;
    if (!(real ? is_in_reach(begin, length) : fits(begin, length)))
        return fail(p, JSONREAD_NO_JSON);
    return jsonread_add(p, real ? JSONREAD_REAL : JSONREAD_INTEGER, begin, length);
}

/* ---- Lists and objects ----------------------------------------------------------------------- */

/* Returns the hash of a key as a set of one, as large as a length. */
static size_t hash_of(const char *key, size_t length)
{
    const unsigned first = (unsigned char)key[0];
    const unsigned middle = (unsigned char)key[length / 2];
    const unsigned last = length > 0 ? (unsigned char)key[length - 1] : 0;
    const size_t sum = first * 5 + middle * 11 + last * 3 + length * 7;
    return (size_t)1 << sum % (CHAR_BIT * sizeof sum);
}

/* Looks for the key among those of the object that is open. */
static bool has_key(const reading *p)
{
    const jsonread_value *end = p->r->values + p->r->value_count;
    for (const jsonread_value *v = p->r->values + p->parent + 1; v < end; v += v->span)
        if (v->key_length == p->key_length && memcmp(v->key, p->key, v->key_length) == 0)
            return true;
    return false;
}

/* Reads a key and its colon. */
static bool take_key(reading *p)
{
    skip_blanks(p);
    if (*p->at++ != '"')
        return fail(p, JSONREAD_NO_JSON);
    if (!take_string(p, &p->key, &p->key_length))
        return false;
    const size_t hash = hash_of(p->key, p->key_length);
    jsonread_value *object = &p->r->values[p->parent];
    if ((object->length & hash) && has_key(p))
        return fail(p, JSONREAD_TWICE);
    object->length |= hash;
    skip_blanks(p);
    return *p->at++ == ':' || fail(p, JSONREAD_NO_JSON);
}

/* Begins a list or an object. */
static bool take_open(reading *p, jsonread_kind kind)
{
    const char *begin = p->text + (p->at - p->r->copy);
    if (p->depth == DEPTH_MAX)
        return fail(p, JSONREAD_NO_JSON);
    if (!jsonread_add(p, kind, begin, 0))
        return false;
    const uint32_t place = (uint32_t)(p->r->value_count - 1);
    p->r->values[place].span = p->parent;
    p->parent = place;
    p->depth++;
    p->at++;
    return true;
}

/* Ends the list or object that is open. */
static void take_close(reading *p)
{
    jsonread_value *v = &p->r->values[p->parent];
    p->at++;
    p->depth--;
    const uint32_t place = p->parent;
    p->parent = v->span;
    v->span = (uint32_t)(p->r->value_count - place);
    v->length = (size_t)(p->text + (p->at - p->r->copy) - v->text);
}

/* ---- The text -------------------------------------------------------------------------------- */

/* Reads a value, or the begin of a list or an object. */
static bool take_value(reading *p)
{
    const char *text;
    size_t length;
    skip_blanks(p);
    switch (*p->at) {
    case '"':
        p->at++;
        return take_string(p, &text, &length) && jsonread_add(p, JSONREAD_STRING, text, length);
    case '{':
        return take_open(p, JSONREAD_OBJECT);
    case '[':
        return take_open(p, JSONREAD_LIST);
    case 'n':
        return take_word(p, JSONREAD_NULL, "null");
    case 'f':
        return take_word(p, JSONREAD_FALSE, "false");
    case 't':
        return take_word(p, JSONREAD_TRUE, "true");
    default:
        return take_number(p);
    }
}

/* Passes over what is behind a value, up to the next one in what is open: ends, a comma, a key.
 * opened: the value is a list or an object. Returns false at the end of all, or with a problem. */
static bool go_on(reading *p, bool opened)
{
    for (bool first = opened; p->parent != NO_PARENT; first = false) {
        const bool list = p->r->values[p->parent].kind == JSONREAD_LIST;
        skip_blanks(p);
        if (*p->at == (list ? ']' : '}')) {
            take_close(p);
            continue;
        }
        if (!first && *p->at++ != ',')
            return fail(p, JSONREAD_NO_JSON);
        p->key = NULL;
        p->key_length = 0;
        return list || take_key(p);
    }
    return false;
}

/* Reads value by value without recursion: depth costs no stack. */
static void jsonread_all(reading *p)
{
    bool more = true;
    while (more && take_value(p)) {
        const jsonread_value *last = &p->r->values[p->r->value_count - 1];
        more = go_on(p, last->kind >= JSONREAD_LIST);
    }
    skip_blanks(p);
    if (p->problem == JSONREAD_GOOD && p->at != p->r->copy + p->length)
        p->problem = JSONREAD_NO_JSON;
}

/* Copies the text, with a final 0. Returns false without memory. */
static bool jsonread_copy(jsonread *r, const char *text, size_t length)
{
    if (r->room <= length) {
        char *copy = realloc(r->copy, 2 * length + 1);
        if (!copy)
            return false;
        r->copy = copy;
        r->room = 2 * length + 1;
    }
    memcpy(r->copy, text, length);
    r->copy[length] = '\0';
    return true;
}

const jsonread_value *jsonread_text(jsonread *r, jsonread_problem *problem, const char *text,
                                    size_t length)
{
    *problem = JSONREAD_NO_MEMORY;
    if (!jsonread_copy(r, text, length))
        return NULL;
    r->value_count = 0;
    reading p = {.r = r, .at = r->copy, .text = text, .length = length, .parent = NO_PARENT};
    jsonread_all(&p);
    *problem = p.problem;
    return p.problem == JSONREAD_GOOD ? r->values : NULL;
}

void jsonread_free(jsonread *r)
{
    free(r->copy);
    free(r->values);
    *r = (jsonread){.copy = NULL};
}

/* ---- What has been read ---------------------------------------------------------------------- */

static inline bool has_name(const jsonread_value *v, const char *key, size_t length)
{
    return v->key_length == length && memcmp(v->key, key, length) == 0;
}

const jsonread_value *jsonread_find(const jsonread_value *object, const jsonread_value *last,
                                    const char *key, size_t length)
{
    if (!jsonread_is(object, JSONREAD_OBJECT))
        return NULL;
    const jsonread_value *v = last ? jsonread_next(object, last) : NULL;
    if (v && has_name(v, key, length))
        return v;
    for (v = jsonread_first(object); v; v = jsonread_next(object, v))
        if (has_name(v, key, length))
            return v;
    return NULL;
}

bool jsonread_uint(uint64_t *out, const jsonread_value *v)
{
    const char *text = jsonread_is(v, JSONREAD_INTEGER) ? v->text : "-";
    return text_take_digits(out, &text, UINT64_MAX);
}

double jsonread_number(const jsonread_value *v)
{
    const bool number = jsonread_is(v, JSONREAD_INTEGER) || jsonread_is(v, JSONREAD_REAL);
    return number ? strtod(v->text, NULL) : 0;
}

/* Compares values that are neither lists nor objects. */
static bool scalars_equal(const jsonread_value *a, const jsonread_value *b)
{
    if (a->kind == JSONREAD_REAL)
        return jsonread_number(a) >= jsonread_number(b) && jsonread_number(a) <= jsonread_number(b);
    return a->length == b->length && memcmp(a->text, b->text, a->length) == 0;
}

/* Returns the value that stands in `other` where v stands in `one`, or NULL. Both are all of a
 * text. */
static const jsonread_value *counterpart(const jsonread_value *one, const jsonread_value *v,
                                         const jsonread_value *other)
{
    while (other && one != v) {
        const jsonread_value *in = jsonread_first(one);
        size_t place = 0;
        for (; in && v >= in + in->span; in = jsonread_next(one, in))
            place++;
        if (!in)
            return NULL;
        const jsonread_value *match = jsonread_first(other);
        if (one->kind == JSONREAD_OBJECT)
            match = jsonread_find(other, NULL, in->key, in->key_length);
        for (; match && one->kind == JSONREAD_LIST && place > 0; place--)
            match = jsonread_next(other, match);
        one = in;
        other = match;
    }
    return other;
}

bool jsonread_equals(const jsonread_value *a, const jsonread_value *b)
{
    if (!a || !b || a->span != b->span)
        return !a && !b;
    for (const jsonread_value *v = a; v < a + a->span; v++) {
        const jsonread_value *other = counterpart(a, v, b);
        if (!other || other->kind != v->kind || other->span != v->span)
            return false;
        if (v->kind < JSONREAD_LIST && !scalars_equal(v, other))
            return false;
    }
    return true;
}
