/* SPDX-License-Identifier: MIT
 *
 * yamlmend.c - accepts unquoted texts with brackets in flow maps and lists: { flip: crc[3] }.
 */
#include "base/text/yamlmend.h"

#include <stdlib.h>
#include <string.h>

#define SHOWN_MAX 60 /* bytes of a text that a message shows */

static const char opening[] = "[{";
static const char closing[] = "]}";
static const char stand_in = '('; /* has no meaning in YAML */

const char *yaml_mend_text(const yaml_mend *self, const char *text)
{
    return self->text ? self->text : text;
}

/* Returns the byte of character n, or size. */
static size_t offset_of(const char *text, size_t size, size_t n)
{
    size_t i = 0;
    while (i < size && (n > 0 || ((unsigned char)text[i] & 0xC0) == 0x80))
        n -= ((unsigned char)text[i++] & 0xC0) != 0x80;
    return i;
}

static bool is_one_of(const char *characters, char c)
{
    return c != '\0' && strchr(characters, c) != NULL;
}

/* Returns true for a character that ends a text without quotes in a flow map or list, on either
 * side. */
static bool is_end(char c)
{
    return is_one_of(" \t\r\n,\"'", c);
}

/* Returns the beginning of the text that has a bracket at an offset. */
static size_t find_begin(const char *text, size_t bracket)
{
    size_t begin = bracket;
    while (begin > 0 && !is_end(text[begin - 1]) && !is_one_of(opening, text[begin - 1]) &&
           !is_one_of(closing, text[begin - 1]))
        begin--;
    return begin;
}

/* Returns the size of the text up to its end; 0: its brackets are not closed. */
static size_t find_size(const char *text, size_t size, size_t begin)
{
    size_t depth = 0;
    size_t end = begin;
    for (; end < size && !is_end(text[end]); end++) {
        if (is_one_of(closing, text[end]) && depth == 0)
            break;
        depth += is_one_of(opening, text[end]);
        depth -= is_one_of(closing, text[end]);
    }
    return depth == 0 ? end - begin : 0;
}

/* Counts characters of UTF-8: libyaml's marks count these, not bytes. */
static size_t count_characters(const char *text, size_t size)
{
    size_t count = 0;
    for (size_t i = 0; i < size; i++)
        count += ((unsigned char)text[i] & 0xC0) != 0x80;
    return count;
}

/* Copies the text once, before the first change to it. False: without memory. */
static bool copy_text(yaml_mend *self, const char *text, size_t size)
{
    if (!self->text)
        self->text = malloc(size);
    if (self->text && self->count == 0)
        memcpy(self->text, text, size);
    return self->text != NULL;
}

/* The text keeps its length, so that places in messages stay right. */
static void replace_brackets(yaml_mend *self, const yaml_mended *found)
{
    for (char *c = self->text + found->offset; c < self->text + found->offset + found->size; c++)
        if (is_one_of(opening, *c) || is_one_of(closing, *c))
            *c = stand_in;
    self->mended[self->count++] = *found;
}

bool yaml_mend_try(yaml_mend *self, const char *text, size_t size, const yaml_mark_t *mark,
                   diag *errors)
{
    const char *now = yaml_mend_text(self, text);
    size_t bracket = offset_of(now, size, mark->index);
    bool enough = self->count == YAML_MENDED_MAX || self->count * size > self->bytes_max;
    if (enough || bracket == size || !is_one_of(opening, now[bracket]))
        return false;
    yaml_mended found = {.offset = find_begin(now, bracket)};
    size_t before = count_characters(now + found.offset, bracket - found.offset);
    found.index = mark->index - before;
    found.size = find_size(now, size, found.offset);
    if (before == 0 || found.size == 0 || !copy_text(self, text, size))
        return false;
    diag_add(errors, mark->line + 1, mark->column + 1 - before,
             "within { } or [ ] a text with brackets needs quotes: \"%.*s\"",
             (int)(found.size < SHOWN_MAX ? found.size : SHOWN_MAX), text + found.offset);
    replace_brackets(self, &found);
    return true;
}

void yaml_mend_restore(const yaml_mend *self, const char *text, yaml_document_t *document)
{
    for (yaml_node_t *node = document->nodes.start; node < document->nodes.top; node++) {
        if (node->type != YAML_SCALAR_NODE)
            continue;
        for (size_t i = 0; i < self->count; i++) {
            const yaml_mended *m = &self->mended[i];
            if (m->index == node->start_mark.index && node->data.scalar.length <= m->size)
                memcpy(node->data.scalar.value, text + m->offset, node->data.scalar.length);
        }
    }
}
