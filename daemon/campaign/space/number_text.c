/* SPDX-License-Identifier: MIT
 *
 * number_text.c - decimal numbers with a unit, exactly: -50, 0.875, 12.5us, 60%.
 */
#include "campaign/space/number_text.h"

#include "base/text/chars.h"
#include "base/text/number.h"

#include <string.h>

#define TIME_UNITS 4
#define MANTISSA_MAX INT64_C(1000000000000000)

/* Takes the rest of a number. It is one word of letters, % and /, or nothing. */
static bool read_unit(char unit[NUMBER_TEXT_UNIT_MAX], const char *at)
{
    static const char letters[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ%/";
    const size_t length = strlen(at);
    if (length >= NUMBER_TEXT_UNIT_MAX || strspn(at, letters) != length)
        return false;
    memcpy(unit, at, length + 1);
    return true;
}

bool number_text_parse(number_text *out, const char *text)
{
    number_text n = {.mantissa = 0};
    uint64_t whole, fraction = 0, one = 1;
    const bool minus = *text == '-';
    const char *at = text + minus;
    if (!text_take_digits(&whole, &at, MANTISSA_MAX))
        return false;
    const char *behind = at + (*at == '.');
    if (*at == '.' && text_take_digits(&fraction, &behind, MANTISSA_MAX)) {
        n.decimals = (unsigned)(behind - at - 1);
        at = behind;
    }
    for (unsigned i = 0; i < n.decimals && i < NUMBER_TEXT_DECIMALS_MAX; i++)
        one *= 10;
    if (n.decimals > NUMBER_TEXT_DECIMALS_MAX || whole > (MANTISSA_MAX - fraction) / one ||
        !read_unit(n.unit, at))
        return false;
    n.mantissa = (int64_t)(whole * one + fraction) * (minus ? -1 : 1);
    *out = n;
    return true;
}

/* Gives a number this many decimals without changing its value. Returns false if it becomes too
 * large. */
static bool widen(number_text *n, unsigned decimals)
{
    for (; n->decimals < decimals; n->decimals++) {
        if (n->mantissa > MANTISSA_MAX / 10 || n->mantissa < -MANTISSA_MAX / 10)
            return false;
        n->mantissa *= 10;
    }
    return true;
}

/* Returns how many times a thousand nanoseconds must grow to be that unit, -1: it is not a time. */
static int time_unit(const char *unit)
{
    static const char *const units[] = {"ns", "us", "ms", "s"};
    for (int i = 0; i < TIME_UNITS; i++)
        if (strcmp(units[i], unit) == 0)
            return i;
    return -1;
}

/* Returns the smallest unit of time, or -1 when there is another unit, or none. */
static int smallest_unit(number_text *const list[], unsigned count)
{
    int smallest = TIME_UNITS;
    for (unsigned i = 0; i < count; i++) {
        const int unit = time_unit(list[i]->unit);
        if (unit < 0 && list[i]->unit[0])
            return -1;
        if (unit >= 0 && unit < smallest)
            smallest = unit;
    }
    return smallest < TIME_UNITS ? smallest : -1;
}

/* Gives a time a smaller unit. Returns false when it has too many digits then. */
static bool lessen(number_text *n, int unit, const char *name)
{
    for (int steps = 3 * (time_unit(n->unit) - unit); steps > 0; steps--) {
        if (n->decimals > 0) {
            n->decimals--;
            continue;
        }
        if (n->mantissa > MANTISSA_MAX / 10 || n->mantissa < -MANTISSA_MAX / 10)
            return false;
        n->mantissa *= 10;
    }
    memmove(n->unit, name, strlen(name) + 1);
    return true;
}

/* Gives all times the smallest of their units. Other numbers stay as they are. */
static bool lessen_all(number_text *const list[], unsigned count)
{
    char name[NUMBER_TEXT_UNIT_MAX] = "";
    const int unit = smallest_unit(list, count);
    for (unsigned i = 0; i < count && unit >= 0; i++)
        if (time_unit(list[i]->unit) == unit)
            memcpy(name, list[i]->unit, sizeof name);
    for (unsigned i = 0; i < count && unit >= 0; i++)
        if (list[i]->unit[0] && !lessen(list[i], unit, name))
            return false;
    return true;
}

bool number_text_align(number_text *const list[], unsigned count)
{
    unsigned decimals = 0;
    if (!lessen_all(list, count))
        return false;
    const char *unit = "";
    for (unsigned i = 0; i < count; i++) {
        decimals = list[i]->decimals > decimals ? list[i]->decimals : decimals;
        unit = list[i]->unit[0] ? list[i]->unit : unit;
    }
    for (unsigned i = 0; i < count; i++) {
        if (strcmp(list[i]->unit, unit) != 0 && (list[i]->unit[0] || list[i]->mantissa != 0))
            return false;
        if (!widen(list[i], decimals))
            return false;
        memmove(list[i]->unit, unit, strlen(unit) + 1);
    }
    return true;
}

void number_text_print(char out[NUMBER_TEXT_MAX], const number_text *n)
{
    const uint64_t size = (uint64_t)(n->mantissa < 0 ? -n->mantissa : n->mantissa);
    uint64_t unit = 1;
    for (unsigned i = 0; i < n->decimals; i++)
        unit *= 10;
    const char *quote = n->unit[0] ? "\"" : "";
    char *at = chars_text(out, quote);
    at = chars_text(at, n->mantissa < 0 ? "-" : "");
    at = chars_decimal(at, size / unit);
    if (n->decimals > 0)
        at = chars_digits(chars_text(at, "."), size % unit, n->decimals);
    at = chars_text(chars_text(at, n->unit), quote);
    *at = '\0';
}
