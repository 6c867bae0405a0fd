/* SPDX-License-Identifier: MIT
 *
 * source.h - the files that a configuration is read from, and the messages about them.
 */
#ifndef CANWIRE_CONFIG_SOURCE_H
#define CANWIRE_CONFIG_SOURCE_H

#include "config/walk.h"

/* Resolves a path relative to the directory of the file that names it. Returns NULL after a
 * complaint. */
char *cfg_resolve_path(schema *self, const char *file, const char *path);

/* Returns true when a regular file is there to be loaded; any: or something else. */
bool cfg_has_file(const schema *self, const char *file, bool any);

/* Loads the document of a file and keeps its text in the configuration. Returns false after a
 * complaint. */
bool cfg_load_file(schema *self, yaml_document_t *document, const char *file);

/* Moves the warnings of a file without errors into its memory; returns false after a complaint. */
bool cfg_keep_warnings(const char **warnings, arena *memory, diag *found);

/* Reads the root of a text. */
typedef void cfg_root_reader(schema *self, yaml_node_t *root);

/* Reads a text that is one document, into memory of an arena. Without a root there is `nothing`, an
 * error. Returns false after errors. */
bool cfg_read_text(arena *memory, cfg_walk *walk, diag *errors, const char *text, size_t size,
                   cfg_root_reader *read, const char *nothing);

#endif
