/* SPDX-License-Identifier: MIT
 *
 * xmltext.c - text in XML and HTML.
 */
#include "base/text/xmltext.h"

#include "base/text/plain.h"

#include <string.h>

/* Returns the bytes of a character that may be written, 0 for others. These are not seen as
 * themselves, or XML does not allow them: U+FFFE and U+FFFF. */
static size_t size_of(const char *text, const char *allowed)
{
    if (strncmp(text, "\xEF\xBF\xBE", 3) == 0 || strncmp(text, "\xEF\xBF\xBF", 3) == 0)
        return 0;
    return strchr(allowed, text[0]) ? 1 : plain_size(text);
}

/* Writes '?' for a character that XML does not allow, and for each byte that is not UTF-8. */
static void write_escaped(FILE *out, const char *text, const char *allowed)
{
    size_t size;
    for (; *text; text += size) {
        size = size_of(text, allowed);
        if (size == 0)
            fputc('?', out);
        else if (*text == '&')
            fputs("&amp;", out);
        else if (*text == '<')
            fputs("&lt;", out);
        else if (*text == '>')
            fputs("&gt;", out);
        else if (*text == '"')
            fputs("&quot;", out);
        else
            (void)fwrite(text, 1, size, out);
        if (size == 0) /* the others of its bytes are not characters by themselves */
            for (size = 1; ((unsigned char)text[size] & 0xC0u) == 0x80u;)
                size++;
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
