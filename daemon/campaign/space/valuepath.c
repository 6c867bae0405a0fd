/* SPDX-License-Identifier: MIT
 *
 * valuepath.c - the path of a value in a configuration: nodes.engine.traffic[0].every.
 */
#include "campaign/space/valuepath.h"

#include <string.h>

static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-";
static const char digits[] = "0123456789";

/* Passes over a key. Returns what is wrong with it, or NULL. */
static const char *pass_key(const char **at)
{
    const size_t length = strspn(*at, letters);
    if (length == 0)
        return "expected a key, or the name of an item: letters, digits, '_' and '-'";
    if (length >= VALUEPATH_PART_MAX)
        return "a key has at most 127 characters";
    *at += length;
    return strchr(".[", **at) ? NULL : "expected '.', '[' or the end";
}

/* Passes over the number of an item, from its bracket on. */
static const char *pass_number(const char **at)
{
    const size_t length = strspn(*at + 1, digits);
    const bool padded = length > 1 && (*at)[1] == '0';
    if (length == 0 || padded || (*at)[1 + length] != ']' || length >= VALUEPATH_PART_MAX)
        return "expected the number of an item, such as [0] or [12]";
    *at += length + 2;
    return strchr(".[", **at) ? NULL : "expected '.', '[' or the end";
}

const char *valuepath_check(arena *memory, const char *path)
{
    const char *at = path;
    const char *wrong = pass_key(&at);
    while (!wrong && *at) {
        at += *at == '.';
        wrong = *at == '[' && at[-1] != '.' ? pass_number(&at) : pass_key(&at);
    }
    if (!wrong)
        return NULL;
    const char *text = arena_print(memory, "%s at character %zu", wrong, (size_t)(at - path) + 1);
    return text ? text : "out of memory";
}

void valuepath_take(const char **rest, valuepath_part *p)
{
    const char *at = *rest;
    p->number = *at == '[';
    at += p->number;
    const size_t length = strspn(at, p->number ? digits : letters);
    memcpy(p->text, at, length);
    p->text[length] = '\0';
    at += length + p->number;
    at += *at == '.';
    p->last = *at == '\0';
    *rest = at;
}
