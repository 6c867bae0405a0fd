/* SPDX-License-Identifier: MIT
 *
 * xmltext.c - text in XML and HTML.
 */
#include "base/xmltext.h"

#include <stdbool.h>
#include <string.h>

/* Returns true for a character that XML does not allow: a control character but for those of
 * `allowed`, or the UTF-8 of U+FFFE or U+FFFF. */
static bool is_forbidden(const char *text, const char *allowed)
{
    return ((unsigned char)text[0] < ' ' && !strchr(allowed, text[0])) ||
           strncmp(text, "\xEF\xBF\xBE", 3) == 0 || strncmp(text, "\xEF\xBF\xBF", 3) == 0;
}

static void write_escaped(FILE *out, const char *text, const char *allowed)
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
            if (!is_forbidden(text, allowed)) {
                fputc(*text, out);
                break;
            }
            fputc('?', out);
            text += (unsigned char)*text < ' ' ? 0 : 2;
            break;
        }
    }
}

void xml_text(FILE *out, const char *text)
{
    write_escaped(out, text, "\n\t");
}

void xml_value(FILE *out, const char *text)
{
    write_escaped(out, text, ""); /* readers make blanks of ends of lines there */
}

void xml_attribute(FILE *out, const char *name, const char *value)
{
    fprintf(out, " %s=\"", name);
    xml_value(out, value);
    fputc('"', out);
}
