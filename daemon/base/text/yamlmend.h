/* SPDX-License-Identifier: MIT
 *
 * yamlmend.h - accepts unquoted texts with brackets in flow maps and lists: { flip: crc[3] }.
 *
 * YAML begins a list at such a bracket, finds a syntax error, and reads nothing behind it. Other
 * characters stand in for these brackets here, so that the rest of the file is read and its errors
 * are reported, too.
 */
#ifndef CANWIRE_BASE_YAMLMEND_H
#define CANWIRE_BASE_YAMLMEND_H

#include "base/diag.h"

#include <yaml.h>

#define YAML_MENDED_MAX 20u /* of one file, which is read again each time */

/* A mended text; places are counted in characters, as by libyaml, and in bytes. */
typedef struct yaml_mended {
    size_t index;
    size_t offset;
    size_t size;
} yaml_mended;

/* The mended texts of a file. All zeros, except for bytes_max, means none. */
typedef struct yaml_mend {
    char *text;       /* the file with stand-ins, to be freed; NULL: nothing was mended */
    size_t bytes_max; /* bytes that may be read again, in all; the last time may exceed them */
    size_t count;
    yaml_mended mended[YAML_MENDED_MAX];
} yaml_mend;

/* Returns the text to parse: that of the file, or the mended one. */
const char *yaml_mend_text(const yaml_mend *self, const char *text);

/* Mends a text after the parser has failed at a mark, if unquoted brackets were the cause. Returns
 * true after a report; the text must then be parsed again. */
bool yaml_mend_try(yaml_mend *self, const char *text, size_t size, const yaml_mark_t *mark,
                   diag *errors);

/* Restores the brackets in a document that was loaded from the mended text. */
void yaml_mend_restore(const yaml_mend *self, const char *text, yaml_document_t *document);

#endif
