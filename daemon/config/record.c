/* SPDX-License-Identifier: MIT
 *
 * record.c - the keys of `record`: the recordings of a running bus.
 */
#include "config/parts.h"
#include "config/source.h"

#include "base/file/spool.h"

#include <limits.h>
#include <string.h>
#include <sys/stat.h>

static schema_reader record_read_file, read_size;

static const schema_range files_range = {1, SPOOL_FILES_MAX, sizeof(uint32_t)};

static const schema_choice formats[] = {
    {.name = "candump", .value = CFG_RECORD_CANDUMP},
    {.name = "pcapng", .value = CFG_RECORD_PCAPNG},
    {.name = "vcd", .value = CFG_RECORD_VCD},
    {.name = NULL},
};

static const struct {
    const char *suffix;
    cfg_record_format format;
} suffixes[] = {
    {".log", CFG_RECORD_CANDUMP},
    {".candump", CFG_RECORD_CANDUMP},
    {".pcapng", CFG_RECORD_PCAPNG},
    {".vcd", CFG_RECORD_VCD},
};

#define MEMBER(member) .offset = offsetof(cfg_record, member)

const schema_key cfg_record_keys[] = {
    {.name = "file", .read = record_read_file, .required = true, .type = "text",
     .help = "Relative to this file; the directory must exist."},
    {.name = "format", .read = schema_read_choice, MEMBER(format), .arg = formats,
     .help = "Default: by the end of the name (.log, .candump, .pcapng, .vcd)."},
    {.name = "size", .read = read_size, MEMBER(size),
     .type = "{'type': ['string', 'integer'], 'pattern': "
             "'^(0|[1-9][0-9]{0,8})(|kB|MB|GB|KiB|MiB|GiB)$'}", .preset = "100MB",
     .help = "When a file has reached it, the next is begun: 64kB to 1000GB."},
    {.name = "files", .read = schema_read_uint, MEMBER(files), .arg = &files_range, .preset = "5",
     .help = "That are kept."},
    {.name = NULL,
     .type = "{'if': " TYPE_NEEDS("format") ", 'then': true, 'else': {'properties': {'file': "
             "{'pattern': '.\\.(log|candump|pcapng|vcd)$'}}}}"},
};

void cfg_record_default(cfg_record *record)
{
    *record = (cfg_record){.file = NULL};
    schema_read_presets(&(schema){.has_open = false}, cfg_record_keys, record);
}

bool cfg_record_format_of_file(cfg_record_format *format, const char *file)
{
    size_t length = strlen(file);
    for (size_t i = 0; i < sizeof suffixes / sizeof suffixes[0]; i++) {
        size_t tail = strlen(suffixes[i].suffix);
        if (length > tail && strcmp(file + length - tail, suffixes[i].suffix) == 0) {
            *format = suffixes[i].format;
            return true;
        }
    }
    return false;
}

bool cfg_record_format_of_name(cfg_record_format *format, const char *name)
{
    for (const schema_choice *c = formats; c->name; c++)
        if (strcmp(c->name, name) == 0) {
            *format = (cfg_record_format)c->value;
            return true;
        }
    return false;
}

const char *cfg_record_format_name(cfg_record_format format)
{
    return formats[format].name;
}

const char *cfg_record_parse_size(uint64_t *size, const char *text)
{
    uint64_t bytes = 0;
    const char *wrong = text_parse_size(&bytes, text);
    if (!wrong && (bytes < CFG_RECORD_SIZE_MIN || bytes > CFG_RECORD_SIZE_MAX))
        wrong = "expected a size from 64kB to 1000GB";
    if (!wrong)
        *size = bytes;
    return wrong;
}

/* Removes parts of a path without meaning: `.` and repeated slashes. */
static void tidy_path(char *path)
{
    char *to = path;
    for (const char *from = path; *from;) {
        size_t length = strcspn(from, "/");
        bool nothing = (length == 0 && from > path) || (length == 1 && *from == '.');
        length += from[length] == '/';
        if (!nothing || from[length] == '\0')
            to = (char *)memmove(to, from, length) + length;
        from += length;
    }
    *to = '\0';
}

/* Finds the directory that a path ends in, and the name there. */
static bool find_directory(struct stat *directory, const char **name, const char *path)
{
    const char *slash = strrchr(path, '/');
    char text[PATH_MAX] = ".";
    size_t length = slash ? (size_t)(slash - path) + 1 : 0;
    if (length >= sizeof text)
        return false;
    memcpy(text, path, length);
    *name = path + length;
    return stat(text, directory) == 0;
}

/* Returns true for the same file, also by another path to its directory, if that exists already. */
static bool same_file(const schema *self, const char *a, const char *b)
{
    const cfg_walk *walk = self->user;
    struct stat in_a;
    struct stat in_b;
    const char *name_a;
    const char *name_b;
    if (strcmp(a, b) == 0)
        return true;
    return !walk->given && find_directory(&in_a, &name_a, a) &&
           find_directory(&in_b, &name_b, b) && in_a.st_dev == in_b.st_dev &&
           in_a.st_ino == in_b.st_ino && strcmp(name_a, name_b) == 0;
}

/* Complains when an earlier entry has this file already. */
static void check_file(schema *self, const schema_key *key, const yaml_node_t *value,
                       const cfg_record *record)
{
    const cfg *config = cfg_of(self);
    for (size_t i = 0; record->file && i < config->record_count; i++)
        if (config->records[i].file && same_file(self, config->records[i].file, record->file))
            schema_complain(self, value, "duplicate %s '%s'", key->name, record->file);
}

/* Keeps the path in its plain form, in which two entries can be compared. */
static void record_read_file(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_record *record = object;
    const char *text = schema_text(self, key, value, "the path of a file");
    if (!text)
        return;
    record->place = cfg_place_of(value);
    record->file = cfg_resolve_path(self, cfg_of(self)->file, text);
    if (record->file)
        tidy_path(record->file);
    check_file(self, key, value, record);
}

static void read_size(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const char *text = schema_text(self, key, value, "a size such as 100MB");
    if (text)
        schema_problem(self, key, value, cfg_record_parse_size(schema_member(key, object), text));
}

/* Reads a recording, whose format may follow from the name of its file. */
static void read_record(schema *self, yaml_node_t *value, cfg_record *record)
{
    cfg_record_default(record);
    schema_map(self, "record", value, cfg_record_keys, record);
    if (value->type != YAML_MAPPING_NODE || schema_find(self, value, "format"))
        return;
    if (record->file && !cfg_record_format_of_file(&record->format, record->file))
        schema_complain(self, schema_find(self, value, "file"),
                        "file: the name ends in none of .log, .candump, .pcapng and .vcd: the key "
                        "'format' is needed");
}

/* Reads recordings one by one, so that each is compared with those before it. */
void cfg_read_record(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;
    size_t count = schema_count(self, key, value, 0, CFG_RECORDS_MAX);
    config->records = schema_alloc(self, count + 1, sizeof *config->records);
    if (!config->records)
        return;
    for (; config->record_count < count; config->record_count++)
        read_record(self, schema_item(self, value, config->record_count),
                    &config->records[config->record_count]);
}
