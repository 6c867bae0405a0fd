/* SPDX-License-Identifier: MIT
 *
 * xmltext.c - text in XML and HTML.
 */
#include "base/xmltext.h"

#include <stdbool.h>
#include <string.h>

/* Returns true for a character that XML does not allow: a control character, or the UTF-8 of U+FFFE
 * or U+FFFF. */
static bool is_forbidden(const char *text)
{
    return ((unsigned char)text[0] < ' ' && text[0] != '\n' && text[0] != '\t') ||
           strncmp(text, "\xEF\xBF\xBE", 3) == 0 || strncmp(text, "\xEF\xBF\xBF", 3) == 0;
}

void xml_text(FILE *out, const char *text)
{
    for (; *text; text++) {
        switch (*text) {
        case '&':
            fputs("&amp;", out);
            break;
        case '<':
            fputs("&lt;", out);
            break;
        case '>':
            fputs("&gt;", out);
            break;
        case '"':
            fputs("&quot;", out);
            break;
        default:
            if (!is_forbidden(text)) {
                fputc(*text, out);
                break;
            }
            fputc('?', out);
            text += (unsigned char)*text < ' ' ? 0 : 2;
            break;
        }
    }
}

void xml_attribute(FILE *out, const char *name, const char *value)
{
    fprintf(out, " %s=\"", name);
    xml_text(out, value);
    fputc('"', out);
}
