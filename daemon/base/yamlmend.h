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

#define YAML_MENDED_MAX 20u /* of one file: each time it is read again */

/* A text that is mended; places are counted in characters as libyaml does, and in bytes. */
typedef struct yaml_mended {
    size_t index;
    size_t offset;
    size_t size;
} yaml_mended;

/* All zeros, but for bytes_max, is nothing mended. */
typedef struct yaml_mend {
    char *text;       /* the file with stand-ins, to be freed; NULL: as it is */
    size_t bytes_max; /* that may be read again, in all; once more than that is fine */
    size_t count;
    yaml_mended mended[YAML_MENDED_MAX];
} yaml_mend;

/* Returns the text to parse: that of the file, or the mended one. */
const char *yaml_mend_text(const yaml_mend *self, const char *text);

/* The parser has failed at a mark: whether that was for brackets without quotes. Then it is told,
 * and the text is to be parsed again. */
bool yaml_mend_try(yaml_mend *self, const char *text, size_t size, const yaml_mark_t *mark,
                   diag *errors);

/* Puts the brackets into a document that was loaded from the mended text. */
void yaml_mend_restore(const yaml_mend *self, const char *text, yaml_document_t *document);

#endif
