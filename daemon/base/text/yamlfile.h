/* SPDX-License-Identifier: MIT
 *
 * yamlfile.h - reads one YAML document from a file or text of bounded size.
 */
#ifndef CANWIRE_BASE_YAMLFILE_H
#define CANWIRE_BASE_YAMLFILE_H

#include "base/diag.h"

#include <yaml.h>

#define YAML_FILE_MAX (4u << 20)   /* bytes of a file */
#define YAML_TEXT_NODES_MAX 20000u /* values and keys; the bus waits while a text is read */
#define YAML_DEPTH_MAX 64u         /* nested lists and maps; libyaml is quadratic in it */
#define YAML_ANCHORED_MAX 4096u    /* bytes of a text that aliases name */

/* The limits of a document. */
typedef struct yaml_limits {
    size_t nodes;        /* values and keys */
    size_t anchors;      /* libyaml's search for them is linear */
    size_t mended_bytes; /* see yaml_mend */
} yaml_limits;

extern const yaml_limits yaml_file_limits;
extern const yaml_limits yaml_text_limits; /* of a text that is read while the bus waits */

/* Returns the content of a file, to be freed; it may exceed the loadable size by one byte. regular:
 * pipes and devices are refused. Returns NULL after a message to `errors`. */
char *yaml_file_read(size_t *size, const char *file, bool regular, diag *errors);

/* Loads the only document of a text within these limits. Aliases are resolved to their nodes, so
 * the document may be a graph, even with cycles. Returns false after a message to `errors`;
 * *document must not be deleted then. */
bool yaml_text_load(yaml_document_t *document, const char *text, size_t size,
                    const yaml_limits *limits, diag *errors);

#endif
