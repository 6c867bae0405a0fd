/* SPDX-License-Identifier: MIT
 *
 * counted.c - a number with its noun, "1 frame" or "2 frames".
 */
#include "base/text/counted.h"

#include <inttypes.h>
#include <stdbool.h>
#include <stdio.h>
#include <string.h>

counted_text counted(uint64_t count, const char *noun)
{
    counted_text out;
    const size_t length = strlen(noun);
    const char last = noun[length > 0 ? length - 1 : 0];
    const bool is_y = last == 'y' && length > 1 && !strchr("aeiou", noun[length - 2]);
    if (count == 1)
        (void)snprintf(out.text, sizeof out.text, "1 %s", noun);
    else
        (void)snprintf(out.text, sizeof out.text, "%" PRIu64 " %.*s%s", count,
                       (int)length - is_y, noun, is_y ? "ies" : last == 's' ? "es" : "s");
    return out;
}
