/* SPDX-License-Identifier: MIT
 *
 * record_files.c - checks that canwire record does not write to a file of the bus.
 *
 * canwired reports its files under their given names, so a path may be relative to the folder in
 * which canwired was started. Only canwired's own user and root can see that folder. Other users
 * cannot replace its files, unless they may write to their folders.
 */
#include "cli/record_files.h"

#include "base/file/fileuse.h"
#include "base/text/jsonput.h"
#include "base/file/spool.h"
#include "config/node/portname.h"

#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define CHECK_NAME "canwire record"

typedef struct bus_files {
    fileuses uses;
    char **paths; /* of the uses, to be freed */
    size_t count;
    char folder[PATH_MAX]; /* in which canwired runs; empty: unknown */
} bus_files;

static void record_files_find_folder(char folder[PATH_MAX], const json_t *status)
{
    char link[64];
    (void)snprintf(link, sizeof link, "/proc/%jd/cwd", get_number(status, "pid"));
    ssize_t length = readlink(link, folder, PATH_MAX - 1);
    folder[length > 0 ? length : 0] = '\0';
}

/* Returns the path by which this process can open the file, to be freed. */
static char *make_path(const bus_files *files, const char *name)
{
    char *path = NULL;
    if (*name == '/' || *files->folder == '\0')
        return strdup(name);
    return asprintf(&path, "%s/%s", files->folder, name) < 0 ? NULL : path;
}

/* Returns the path of a name in the status. Returns NULL for a missing name, and without memory. */
static const char *keep_path(bus_files *files, const char *name)
{
    if (!name)
        return NULL;
    char *path = make_path(files, name);
    files->uses.incomplete = files->uses.incomplete || !path;
    if (path)
        files->paths[files->count++] = path;
    return path;
}

/* Adds a file under a name, if there is one. */
static void add_name(bus_files *files, const json_t *name, fileuse use)
{
    use.path = keep_path(files, json_string_value(name));
    if (use.path)
        fileuses_add(&files->uses, &use);
}

/* Adds the file that an object of the status names. */
static void add_file(bus_files *files, const json_t *object, fileuse use)
{
    add_name(files, json_object_get(object, "file"), use);
}

static void add_socket(bus_files *files, const char *name, const char *what)
{
    const fileuse use = {.what = what, .path = keep_path(files, name)};
    if (use.path)
        fileuses_add_socket(&files->uses, &use);
}

/* Returns true when a node before this one has the same port: guests share one. */
static bool is_shared(const json_t *nodes, size_t node, const char *port)
{
    size_t i = 0;
    while (i < node) {
        const char *text = get_text(json_array_get(nodes, i), "port");
        if (text && strcmp(text, port) == 0)
            break;
        i++;
    }
    return i < node;
}

static void add_port(bus_files *files, const json_t *nodes, size_t node)
{
    const char *text = get_text(json_array_get(nodes, node), "port");
    const portname port = portname_parse(text ? text : "");
    if (port.path && !is_shared(nodes, node, text))
        add_socket(files, port.path, "the bus' port");
}

/* Adds a "record" with its rotated files. */
static void add_recording(bus_files *files, const json_t *recording)
{
    const json_int_t kept = get_number(recording, "files");
    const bool rotated = kept > 1 && kept <= SPOOL_FILES_MAX;
    add_file(files, recording,
             (fileuse){.what = "the bus' record",
                       .written = true,
                       .older = rotated ? (unsigned)kept - 1 : 0});
}

static void add_files(bus_files *files, const json_t *status)
{
    const json_t *recordings = json_object_get(status, "recordings");
    const json_t *reads = json_object_get(status, "reads");
    const json_t *nodes = json_object_get(status, "nodes");
    add_file(files, status, (fileuse){.what = "the configuration"});
    for (size_t i = 0; i < json_array_size(reads); i++)
        add_name(files, json_array_get(reads, i), (fileuse){.what = "the bus' input"});
    add_socket(files, get_text(status, "control"), "the bus' control");
    for (size_t i = 0; i < json_array_size(nodes); i++)
        add_port(files, nodes, i);
    for (size_t i = 0; i < json_array_size(recordings); i++)
        add_recording(files, json_array_get(recordings, i));
    add_file(files, json_object_get(status, "journal"),
             (fileuse){.what = "the bus' journal", .written = true});
}

/* Returns the largest number of names: besides these the configuration, the journal and the
 * socket. */
static size_t count_names(const json_t *status)
{
    return json_array_size(json_object_get(status, "recordings")) +
           json_array_size(json_object_get(status, "reads")) +
           json_array_size(json_object_get(status, "nodes")) + 3;
}

bool record_check_files(const cfg_record *what, const json_t *status)
{
    bus_files files = {.count = 0};
    const size_t most = count_names(status);
    files.paths = calloc(most, sizeof *files.paths);
    if (!files.paths) {
        fputs(CHECK_NAME ": out of memory\n", stderr);
        return false;
    }
    record_files_find_folder(files.folder, status);
    add_files(&files, status);
    fileuses_add(
        &files.uses,
        &(fileuse){.what = "", .path = what->file, .written = true, .older = what->files - 1});
    bool good = fileuses_check(&files.uses, CHECK_NAME, stderr);
    for (size_t i = 0; i < files.count; i++)
        free(files.paths[i]);
    free(files.paths);
    fileuses_free(&files.uses);
    return good;
}
