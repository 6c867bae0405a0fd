/* SPDX-License-Identifier: MIT
 *
 * source.c - the files that a configuration is read from, and the messages about them.
 */
#include "config/source.h"

#include "base/text/memo.h"
#include "base/text/yamlfile.h"
#include "config/profilefile.h"

#include <stdlib.h>
#include <string.h>

char *cfg_resolve_path(schema *self, const char *file, const char *path)
{
    const char *slash = strrchr(file, '/');

    size_t directory = path[0] == '/' || !slash ? 0 : (size_t)(slash - file) + 1;
    char *resolved = schema_alloc(self, directory + strlen(path) + 1, 1);

    if (resolved) {
        memcpy(resolved, file, directory);
        strcpy(resolved + directory, path);
    }
    return resolved;
}

/* Returns a file that has been read before, or NULL. */
static const cfg_file *find_file(const cfg_file *files, size_t count, const char *name)
{
    for (size_t i = 0; i < count; i++)
        if (strcmp(files[i].name, name) == 0)
            return &files[i];
    return NULL;
}

/* Keeps the text of a file that has been read, for the journal and for reloads. */
static const cfg_file *keep_file(schema *self, const char *name, const char *text, size_t size)
{
    cfg *config = cfg_of(self);
    cfg_file *files = schema_alloc(self, config->file_count + 1, sizeof *files);
    char *copy = schema_alloc(self, size + 1, 1);
    char *own_name = schema_copy(self, name);

    if (!files || !copy || !own_name)
        return NULL;
    if (config->file_count > 0)
        memcpy(files, config->files, config->file_count * sizeof *files);
    memcpy(copy, text, size);
    config->files = files;
    files[config->file_count] = (cfg_file){.name = own_name, .text = copy, .size = size};
    return &files[config->file_count++];
}

/* Reads a file. A pipe in place of a profile would hang. */
static const cfg_file *read_new_file(schema *self, const char *name)
{
    const cfg_walk *walk = self->user;
    const bool profile = walk->config->file_count > 0;
    size_t size;
    char *text = yaml_file_read(&size, name, walk->regular || profile, self->errors);
    const cfg_file *kept = text ? keep_file(self, name, text, size) : NULL;

    free(text);
    return kept;
}

bool cfg_has_file(const schema *self, const char *file, bool any)
{
    const cfg_walk *walk = self->user;
    const cfg *config = walk->config;

    return find_file(config->files, config->file_count, file) ||
           find_file(walk->given, walk->given_count, file) ||
           (cfg_reads_files(self) && profilefile_is_there(file, any));
}

bool cfg_load_file(schema *self, yaml_document_t *document, const char *file)
{
    const cfg_walk *walk = self->user;
    const cfg *config = walk->config;
    const cfg_file *found = find_file(config->files, config->file_count, file);
    const cfg_file *given = find_file(walk->given, walk->given_count, file);

    if (!found && given)
        found = keep_file(self, file, given->text, given->size);
    else if (!found && cfg_reads_files(self))
        found = read_new_file(self, file);
    else if (!found)
        diag_add(self->errors, 0, 0, "this file is not among those that are given");
    return found &&
           yaml_text_load(document, found->text, found->size, &yaml_file_limits, self->errors);
}

bool cfg_keep_warnings(const char **warnings, arena *memory, diag *found)
{
    memo said;

    if (memo_begin(&said))
        diag_flush(found, said.out);
    const char *text = memo_text(&said);
    *warnings = text ? arena_print(memory, "%s", text) : NULL;
    memo_end(&said);
    if (!*warnings)
        diag_add(found, 0, 0, "out of memory");
    return *warnings != NULL;
}

/* ---- Texts ----------------------------------------------------------------------------------- */

bool cfg_read_text(arena *memory, cfg_walk *walk, diag *errors, const char *text, size_t size,
                   cfg_root_reader *read, const char *nothing)
{
    yaml_document_t document;
    schema self = {
        .errors = errors,
        .arena = memory,
        .document = &document,
        .user = walk,
    };

    if (!yaml_text_load(&document, text, size, &yaml_text_limits, errors))
        return false;
    yaml_node_t *root = yaml_document_get_root_node(&document);
    if (root)
        read(&self, root);
    else
        diag_add(errors, 1, 1, "%s", nothing);
    yaml_document_delete(&document);
    return errors->errors == 0;
}
