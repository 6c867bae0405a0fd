/* SPDX-License-Identifier: MIT
 *
 * jsonvalue.c - values of a YAML document as JSON, which YAML is, too.
 */
#include "campaign/space/jsonvalue.h"

#include "base/text/jsonput.h"
#include "base/text/buffer.h"
#include "base/text/jsontext.h"

#include <stdlib.h>
#include <string.h>

#define DEPTH_MAX 16u       /* aliases may form a cycle */
#define BYTES_MAX (1u << 20) /* of a value, with its aliases written out */

static const char *digits(const char *at)
{
    return at + strspn(at, "0123456789");
}

/* Returns true for a number as JSON writes it, without exponent. */
static bool is_number(const char *text)
{
    const char *at = text + (*text == '-');
    const char *end = digits(at);
    if (end == at || (*at == '0' && end - at > 1))
        return false;
    if (*end == '.' && digits(end + 1) > end + 1)
        end = digits(end + 1);
    return *end == '\0';
}

static bool is_word(const char *text)
{
    return strcmp(text, "true") == 0 || strcmp(text, "false") == 0;
}

/* A plain scalar that JSON would read as a number or a word stays one; all others are texts. */
static void put_scalar(buffer *out, const yaml_node_t *value)
{
    const char *text = (const char *)value->data.scalar.value;
    const bool plain = value->data.scalar.style == YAML_PLAIN_SCALAR_STYLE;
    if (schema_is_null(value))
        buffer_put(out, "null");
    else if (plain && (is_number(text) || is_word(text)))
        buffer_put(out, text);
    else
        jsontext_quoted(out, text);
}

/* A list or a map of which some items are written. */
typedef struct level {
    const yaml_node_t *node;
    size_t next;
} level;

typedef struct writer {
    buffer *out;
    schema *schema;
    level levels[DEPTH_MAX];
    unsigned depth; /* levels in use */
    const char *wrong; /* NULL: nothing */
} writer;

static bool is_list(const yaml_node_t *node)
{
    return node->type == YAML_SEQUENCE_NODE;
}

/* Writes a scalar, or begins a list or a map. */
static void begin_value(writer *w, const yaml_node_t *value)
{
    if (value->type == YAML_SCALAR_NODE) {
        if (strlen((const char *)value->data.scalar.value) != value->data.scalar.length)
            w->wrong = "NUL characters are not allowed";
        put_scalar(w->out, value);
        return;
    }
    if (w->depth == DEPTH_MAX) {
        w->wrong = "this value is nested too deeply";
        return;
    }
    buffer_put(w->out, is_list(value) ? "[" : "{");
    w->levels[w->depth++] = (level){.node = value};
}

/* Returns the next item of a list, or value of a map, whose key is written; NULL at the end. */
static const yaml_node_t *next_value(writer *w, level *l)
{
    yaml_node_t *value = NULL;
    const char *comma = l->next > 0 ? "," : "";
    if (is_list(l->node)) {
        const yaml_node_item_t *item = l->node->data.sequence.items.start + l->next++;
        if (item >= l->node->data.sequence.items.top)
            return NULL;
        buffer_put(w->out, comma);
        return yaml_document_get_node(w->schema->document, *item);
    }
    const yaml_node_t *key = schema_pair(w->schema, &value, l->node, l->next++);
    if (!key)
        return NULL;
    buffer_put(w->out, comma);
    const bool good = key->type == YAML_SCALAR_NODE;
    if (!good)
        w->wrong = "the keys of this value are no texts";
    jsontext_quoted(w->out, good ? (const char *)key->data.scalar.value : "");
    buffer_put(w->out, ":");
    return value;
}

/* Returns what is wrong with the value, or NULL. */
static const char *put_value(buffer *out, schema *self, const yaml_node_t *value, size_t bytes_max)
{
    writer w = {.out = out, .schema = self};
    begin_value(&w, value);
    while (!w.wrong && w.depth > 0) {
        level *l = &w.levels[w.depth - 1];
        const yaml_node_t *next = next_value(&w, l);
        if (next) {
            begin_value(&w, next);
        } else {
            buffer_put(out, is_list(l->node) ? "]" : "}");
            w.depth--;
        }
        if (buffer_length(out) > bytes_max)
            w.wrong = "this value is too large: one has up to 1 MiB, and all of a file 64 MiB, "
                      "with aliases written out";
    }
    return out->no_memory ? "out of memory" : w.wrong;
}

const char *jsonvalue_of(schema *self, const yaml_node_t *value, size_t *left)
{
    buffer out = {.data = NULL};
    const char *wrong = put_value(&out, self, value, *left < BYTES_MAX ? *left : BYTES_MAX);
    const size_t length = buffer_length(&out);
    const char *json = wrong ? NULL : buffer_text(&out);
    const char *text = json ? schema_print(self, "%s", json) : NULL;
    if (!json)
        schema_complain(self, value, "%s", wrong ? wrong : "out of memory");
    *left -= length < *left ? length : *left;
    buffer_free(&out);
    return text;
}
