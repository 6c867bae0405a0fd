/* SPDX-License-Identifier: MIT
 *
 * journal_read.c - reads a journal line by line.
 *
 * Each line is an object. One key names its kind, and the table at the end has its other keys.
 */
#include "run/journal_read.h"

#include "base/arena.h"
#include "base/text/buffer.h"
#include "base/text/counted.h"
#include "base/text/jsonput.h"
#include "base/text/nearest.h"
#include "base/text/number.h"
#include "base/text/memo.h"
#include "config/values.h"
#include "run/journal_pack.h"
#include "run/journal_seal.h"
#include "run/settings.h"
#include "trace/frametext.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <jansson.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define LINE_BYTES_MAX (512u << 20)
#define READ_BYTES 65536u
#define KEYS_MAX 8
#define FILES_MAX 200u
#define FLAGS_MAX 31u
#define DIGEST_DIGITS 16u
#define LINES_TEXT_MAX 64

struct journal_reader {
    const char *file; /* of the caller */
    FILE *errors;
    int fd;
    journal_unpacker *unpacker;
    buffer bytes;  /* read and not yet used */
    bool at_end;   /* of the file */
    bool over;     /* no entry follows */
    bool failed;   /* to read the file */
    bool torn;     /* the next part of the file cannot be unpacked */
    bool unchecked; /* such a part has been left out, which the next seal is of, too */
    size_t number; /* of the present line, from 1 */
    uint64_t byte; /* the first of it */
    size_t group;  /* bytes of lines to come that a seal has been checked for ... */
    size_t lines;  /* ... and of these lines, when the present one is damaged */
    unsigned version;
    size_t buses;        /* of a rig, or 0 */
    size_t known;        /* of these, by their configurations */
    char *names[RIG_BUSES_MAX];
    size_t ended;        /* buses that have ended */
    uint64_t last; /* the number of the last line that has one */
    uint64_t bare; /* lines since then, which have none */
    uint64_t missing; /* missing lines before that one, which the line of a gap must still
                         explain */
    uint64_t tick; /* its `at` */
    bool damaged;  /* a line before this one is damaged: numbers may have gaps */
    const char *line;
    size_t length;
    json_t *object; /* of the line */
    arena arena;    /* of the entry */
    char *writer;
    char *bus;
    char *started;
};

typedef struct key_spec {
    const char *name;
    json_type type; /* JSON_STRING also stands for {"hex": ...} in members of bytes */
    bool required;
} key_spec;

typedef struct line_spec {
    const char *name;
    journal_kind kind;
    input_kind input;
    bool (*read)(journal_reader *r, journal_entry *entry);
    json_type type;             /* of the value of that key */
    key_spec keys[KEYS_MAX + 1]; /* in addition to `at` and `again` */
} line_spec;

/* ---- Messages -------------------------------------------------------------------------------- */

/* Returns the index behind the text that begins at i with a quote. */
static size_t skip_text(const journal_reader *r, size_t i)
{
    for (i++; i < r->length && r->line[i] != '"'; i++)
        i += r->line[i] == '\\';
    return i + 1;
}

static bool is_key(const journal_reader *r, size_t begin, size_t end, const char *key)
{
    size_t length = strlen(key);
    return end - begin == length + 2 && end < r->length && r->line[end] == ':' &&
           memcmp(r->line + begin + 1, key, length) == 0;
}

/* Returns the column of the value of a key of the outer object, from 1; 1 when it is not found. */
static size_t column_of(const journal_reader *r, const char *key)
{
    unsigned depth = 0;
    for (size_t i = 0; key && i < r->length;) {
        char c = r->line[i];
        if (c != '"') {
            depth += c == '{' || c == '[';
            depth -= (c == '}' || c == ']') && depth > 0;
            i++;
            continue;
        }
        size_t end = skip_text(r, i);
        bool found = depth == 1 && is_key(r, i, end, key);
        for (i = end; found && i + 1 < r->length && r->line[i + 1] == ' '; i++)
            ;
        if (found)
            return i + 2;
    }
    return 1;
}

static void complain_at(journal_reader *r, size_t column, const char *format, va_list args)
{
    fprintf(r->errors, "%s:%zu:%zu: ", r->file, r->number, column);
    vfprintf(r->errors, format, args);
    fputc('\n', r->errors);
}

void journal_complain(journal_reader *r, const char *key, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    complain_at(r, column_of(r, key), format, args);
    va_end(args);
}

/* Returns false, for the caller to return. */
static bool __attribute__((format(printf, 3, 4)))
wrong(journal_reader *r, const char *key, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    complain_at(r, column_of(r, key), format, args);
    va_end(args);
    return false;
}

/* Says where the present line, or lines, are. */
static bool damaged(journal_reader *r, const char *how)
{
    char time[TIME_TEXT_MAX], lines[LINES_TEXT_MAX] = "";
    text_print_seconds(time, r->tick);
    r->damaged = true;
    if (r->lines > 1)
        (void)snprintf(lines, sizeof lines, "lines %zu to %zu, ", r->number,
                       r->number + r->lines - 1);
    return wrong(r, NULL, "damaged: %s, %sbytes %" PRIu64 " to %" PRIu64 " of the %s, behind %s s",
                 how, lines, r->byte, r->byte + r->length,
                 journal_is_packed(r->unpacker) ? "text" : "file", time);
}

static bool no_memory(journal_reader *r)
{
    return wrong(r, NULL, "out of memory");
}

/* ---- Values ---------------------------------------------------------------------------------- */

static const json_t *journal_read_value_of(const journal_reader *r, const char *key)
{
    return json_object_get(r->object, key);
}

static const char *journal_read_text_of(const journal_reader *r, const char *key)
{
    return json_string_value(journal_read_value_of(r, key));
}

/* Reads a number that must be there, from 0 to `max`. */
static bool journal_read_read_number(journal_reader *r, uint64_t *out, const char *key,
                                     uint64_t max)
{
    const json_t *value = journal_read_value_of(r, key);
    if (!json_is_integer(value) || json_integer_value(value) < 0 ||
        (uint64_t)json_integer_value(value) > max)
        return wrong(r, key, "%s: expected a whole number from 0 to %" PRIu64, key, max);
    *out = (uint64_t)json_integer_value(value);
    return true;
}

/* Reads bytes from hexadecimal digits; returns false for other text. */
static bool read_hex(char *bytes, const char *hex, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        uint32_t byte;
        if (!text_parse_hex(&byte, hex + 2 * i, 2))
            return false;
        bytes[i] = (char)byte;
    }
    return hex[2 * count] == '\0';
}

/* Reads a text, or {"hex": ...}; a final 0 follows it. Returns NULL after a complaint about the
 * key. */
static const char *read_bytes(journal_reader *r, size_t *size, const json_t *value, const char *key)
{
    const char *hex = get_text(value, "hex");
    const char *text = json_is_string(value) ? json_string_value(value) : hex;
    if (!text) {
        (void)wrong(r, key, "%s: expected a text or {\"hex\": ...}", key);
        return NULL;
    }
    *size = hex ? strlen(hex) / 2 : json_string_length(value);
    char *bytes = arena_alloc(&r->arena, *size + 1);
    if (!bytes) {
        (void)no_memory(r);
        return NULL;
    }
    if (!hex)
        memcpy(bytes, text, *size);
    else if (!read_hex(bytes, hex, *size)) {
        (void)wrong(r, key, "%s: hex: expected pairs of hexadecimal digits", key);
        return NULL;
    }
    return bytes;
}

/* Reads a text in the same way, but without a 0, which would cut it. */
static const char *read_word(journal_reader *r, const json_t *value, const char *key)
{
    size_t size;
    const char *bytes = read_bytes(r, &size, value, key);
    if (bytes && strlen(bytes) == size && size > 0)
        return bytes;
    if (bytes)
        (void)wrong(r, key, "%s: expected a text that is not empty, without NUL", key);
    return NULL;
}

/* ---- Entries --------------------------------------------------------------------------------- */

/* Reads a frame from its members, for one that has no text as candump writes it. */
static bool read_raw_frame(journal_reader *r, cw_frame *frame)
{
    uint64_t id = 0, flags = 0, dlc = 0; /* compilers do not see that all are assigned */
    char bytes[CW_FRAME_DATA_MAX];
    const char *data = journal_read_text_of(r, "data");
    if (!journal_read_value_of(r, "id") || !journal_read_value_of(r, "flags") ||
        !journal_read_value_of(r, "dlc") || !data)
        return wrong(r, NULL, "send: expected either frame, or id, flags, dlc and data");
    if (!journal_read_read_number(r, &id, "id", UINT32_MAX) ||
        !journal_read_read_number(r, &flags, "flags", FLAGS_MAX) ||
        !journal_read_read_number(r, &dlc, "dlc", UINT8_MAX))
        return false;
    /* before there was CAN FD, 8 bytes were kept of any frame */
    const bool is_short =
        !(flags & CW_FRAME_FD) || strlen(data) == 2 * (size_t)CW_CLASSICAL_DATA_MAX;
    const size_t count = is_short ? CW_CLASSICAL_DATA_MAX : CW_FRAME_DATA_MAX;
    if (strlen(data) != 2 * count || !read_hex(bytes, data, count))
        return wrong(r, "data", "data: expected %zu bytes in hexadecimal digits", count);
    *frame = (cw_frame){.id = (uint32_t)id, .flags = (uint8_t)flags, .dlc = (uint8_t)dlc};
    memcpy(frame->data, bytes, count);
    return true;
}

/* Reads the tick of a frame: from bus time 0 on, or since version 4 from that of the line. */
static bool read_send_tick(journal_reader *r, journal_entry *entry)
{
    uint64_t in = 0;
    if (r->version < JOURNAL_VERSION_GROUPS) {
        if (!journal_read_value_of(r, "tick"))
            return wrong(r, NULL, "send: the key 'tick' is missing");
        return journal_read_read_number(r, &entry->what.at_tick, "tick", INT64_MAX);
    }
    if (journal_read_value_of(r, "in") && !journal_read_read_number(r, &in, "in", INT64_MAX))
        return false;
    entry->what.at_tick = entry->at + in;
    return true;
}

/* Reads a frame that an ECU has sent. */
static bool read_send(journal_reader *r, journal_entry *entry)
{
    const char *frame = journal_read_text_of(r, "frame");
    entry->node = journal_read_text_of(r, "send");
    entry->what.frame = &entry->frame;
    entry->late = journal_read_value_of(r, "late");
    if (!read_send_tick(r, entry))
        return false;
    if (!frame)
        return read_raw_frame(r, &entry->frame);
    if (journal_read_value_of(r, "id") || journal_read_value_of(r, "flags") ||
        journal_read_value_of(r, "dlc") || journal_read_value_of(r, "data"))
        return wrong(r, "frame", "send: expected either frame, or id, flags, dlc and data");
    const char *problem = text_parse_frame(&entry->frame, frame);
    return !problem || wrong(r, "frame", "frame: %s", problem);
}

/* Reads an injected text of rules. `refused` says that the bus did not take them then. */
static bool read_inject(journal_reader *r, journal_entry *entry)
{
    entry->what.text =
        read_bytes(r, &entry->what.size, journal_read_value_of(r, "inject"), "inject");
    entry->what.name =
        entry->what.text ? read_word(r, journal_read_value_of(r, "name"), "name") : NULL;
    entry->what.refused = json_is_true(journal_read_value_of(r, "refused"));
    return entry->what.name != NULL;
}

static bool read_rule(journal_reader *r, journal_entry *entry)
{
    const char *key = entry->what.kind == INPUT_CLEAR ? "clear" : "fire";
    entry->what.rule = journal_read_text_of(r, key);
    return true;
}

static bool read_restart(journal_reader *r, journal_entry *entry)
{
    entry->node = journal_read_text_of(r, "restart");
    return true;
}

/* Reads that an ECU has come or gone. A guest may bring a name of its own. */
static bool read_attach(journal_reader *r, journal_entry *entry)
{
    entry->what.on = journal_read_value_of(r, "attach") != NULL;
    entry->node = journal_read_text_of(r, entry->what.on ? "attach" : "detach");
    entry->what.as = journal_read_value_of(r, "as") ? journal_read_text_of(r, "as") : NULL;
    return !entry->what.as || cfg_name_valid(entry->what.as, CFG_NODE_NAME_MAX) ||
           wrong(r, "as", "as: it cannot be the name of a node");
}

/* Reads settings, by the keys of the configuration. */
static bool read_set(journal_reader *r, journal_entry *entry)
{
    char error[SETTINGS_ERROR_MAX];
    entry->node = journal_read_text_of(r, "set");
    entry->what.settings = &entry->settings;
    entry->what.time = &entry->time;
    return settings_from_json(&entry->settings, &entry->time, error,
                              journal_read_value_of(r, "settings")) ||
           wrong(r, "settings", "settings: %s", error);
}

static bool read_skip(journal_reader *r, journal_entry *entry)
{
    return journal_read_read_number(r, &entry->what.skipped, "skip", INT64_MAX) &&
           (!journal_read_value_of(r, "earlier") ||
            journal_read_read_number(r, &entry->what.earlier, "earlier", INT64_MAX));
}

/* Reads one file of a configuration, with its name and its text. */
static bool journal_read_read_file(journal_reader *r, cfg_file *file, const json_t *value,
                                   const char *key)
{
    if (!json_is_object(value) || json_object_size(value) != 2 || !json_object_get(value, "name") ||
        !json_object_get(value, "text"))
        return wrong(r, key, "%s: expected a list of files, {\"name\": ..., \"text\": ...}", key);
    file->name = read_word(r, json_object_get(value, "name"), key);
    if (!file->name)
        return false;
    file->text = read_bytes(r, &file->size, json_object_get(value, "text"), key);
    return file->text != NULL;
}

/* Reads the files of a configuration, of which there is at least one. */
static bool read_files(journal_reader *r, journal_entry *entry)
{
    const char *key = entry->kind == JOURNAL_CONFIG ? "config" : "reload";
    const json_t *list = journal_read_value_of(r, key);
    size_t count = json_array_size(list);
    if (count == 0 || count > FILES_MAX)
        return wrong(r, key, "%s: expected 1 to %u files", key, FILES_MAX);
    cfg_file *files = arena_alloc(&r->arena, count * sizeof *files);
    if (!files)
        return no_memory(r);
    for (size_t i = 0; i < count; i++)
        if (!journal_read_read_file(r, &files[i], json_array_get(list, i), key))
            return false;
    entry->files = files;
    entry->file_count = count;
    return true;
}

/* Reads a reload. `traffic` is the tick from which the traffic of the new configuration comes. */
static bool read_reload(journal_reader *r, journal_entry *entry)
{
    if (journal_read_value_of(r, "traffic") &&
        !journal_read_read_number(r, &entry->what.at_tick, "traffic", INT64_MAX))
        return false;
    return read_files(r, entry);
}

/* Reads the digest of all events up to here. Old journals have none. */
static bool read_digest(journal_reader *r, journal_entry *entry)
{
    const char *text = journal_read_text_of(r, "digest");
    uint32_t high, low;
    entry->has_digest = text != NULL;
    if (!text)
        return true;
    if (strlen(text) != DIGEST_DIGITS || !text_parse_hex(&high, text, 8) ||
        !text_parse_hex(&low, text + 8, 8))
        return wrong(r, "digest", "digest: expected %u hexadecimal digits", DIGEST_DIGITS);
    entry->digest = (uint64_t)high << 32 | low;
    return true;
}

/* Reads the counters of a mark or of the end. All must be there, and no others. */
static bool read_counters(journal_reader *r, journal_entry *entry)
{
    const char *key = entry->kind == JOURNAL_MARK ? "mark" : "end";
    const json_t *counters = journal_read_value_of(r, key);
    for (size_t i = 0; i < JOURNAL_COUNTERS; i++) {
        const json_t *value = json_object_get(counters, journal_counters[i].name);
        if (!json_is_integer(value) || json_integer_value(value) < 0)
            return wrong(r, key, "%s: expected a whole number at '%s'", key,
                         journal_counters[i].name);
        entry->counters[i] = (uint64_t)json_integer_value(value);
    }
    if (json_object_size(counters) != JOURNAL_COUNTERS)
        return wrong(r, key, "%s: there are more counters than are known", key);
    return read_digest(r, entry);
}

static bool read_gap(journal_reader *r, journal_entry *entry)
{
    entry->why = get_text(journal_read_value_of(r, "gap"), "why");
    return entry->why || wrong(r, "gap", "gap: the key 'why' is missing");
}

static bool read_nothing(journal_reader *r, journal_entry *entry)
{
    (void)r;
    (void)entry;
    return true;
}

static const line_spec specs[] = {
    {"config", JOURNAL_CONFIG, INPUT_COUNT, read_files, JSON_ARRAY, {{NULL, JSON_NULL, false}}},
    {"send", JOURNAL_INPUT, INPUT_SEND, read_send, JSON_STRING,
     {{"tick", JSON_INTEGER, false},
      {"in", JSON_INTEGER, false},
      {"late", JSON_TRUE, false},
      {"frame", JSON_STRING, false},
      {"id", JSON_INTEGER, false},
      {"flags", JSON_INTEGER, false},
      {"dlc", JSON_INTEGER, false},
      {"data", JSON_STRING, false}}},
    {"inject", JOURNAL_INPUT, INPUT_INJECT, read_inject, JSON_NULL,
     {{"name", JSON_NULL, true}, {"refused", JSON_TRUE, false}}},
    {"clear", JOURNAL_INPUT, INPUT_CLEAR, read_rule, JSON_STRING, {{NULL, JSON_NULL, false}}},
    {"fire", JOURNAL_INPUT, INPUT_FIRE, read_rule, JSON_STRING, {{NULL, JSON_NULL, false}}},
    {"restart", JOURNAL_INPUT, INPUT_RESTART, read_restart, JSON_STRING,
     {{NULL, JSON_NULL, false}}},
    {"set", JOURNAL_INPUT, INPUT_SET, read_set, JSON_STRING, {{"settings", JSON_OBJECT, true}}},
    {"attach", JOURNAL_INPUT, INPUT_ATTACH, read_attach, JSON_STRING,
     {{"as", JSON_STRING, false}}},
    {"detach", JOURNAL_INPUT, INPUT_ATTACH, read_attach, JSON_STRING, {{NULL, JSON_NULL, false}}},
    {"skip", JOURNAL_INPUT, INPUT_SKIP, read_skip, JSON_INTEGER,
     {{"earlier", JSON_INTEGER, false}}},
    {"reload", JOURNAL_INPUT, INPUT_RELOAD, read_reload, JSON_ARRAY,
     {{"traffic", JSON_INTEGER, false}}},
    {"mark", JOURNAL_MARK, INPUT_COUNT, read_counters, JSON_OBJECT,
     {{"digest", JSON_STRING, false}}},
    {"end", JOURNAL_END, INPUT_COUNT, read_counters, JSON_OBJECT,
     {{"digest", JSON_STRING, false}}},
    {"gap", JOURNAL_GAP, INPUT_COUNT, read_gap, JSON_OBJECT, {{NULL, JSON_NULL, false}}},
    {"broken", JOURNAL_BROKEN, INPUT_COUNT, read_nothing, JSON_TRUE, {{NULL, JSON_NULL, false}}},
    /* a key of other lines, too, so it is looked for last */
    {"sent", JOURNAL_SENT, INPUT_COUNT, read_nothing, JSON_INTEGER, {{NULL, JSON_NULL, false}}},
};

#define SPECS (sizeof specs / sizeof specs[0])

/* ---- Lines ----------------------------------------------------------------------------------- */

/* Returns true for a key that belongs to the reader, which no line has to name. */
static bool is_common(const journal_reader *r, const char *key)
{
    return strcmp(key, "at") == 0 ||
           (r->buses > 0 && strcmp(key, "bus") == 0) ||
           (r->version >= JOURNAL_VERSION_SEALS &&
            (strcmp(key, "n") == 0 || strcmp(key, "crc") == 0)) ||
           (r->version >= JOURNAL_VERSION_GROUPS && strcmp(key, "sent") == 0);
}

/* Checks the type of a value; JSON_NULL allows any type. */
static bool check_type(journal_reader *r, const char *key, json_type type)
{
    static const char *const names[] = {[JSON_OBJECT] = "an object",
                                        [JSON_ARRAY] = "a list",
                                        [JSON_STRING] = "a text",
                                        [JSON_INTEGER] = "a whole number",
                                        [JSON_TRUE] = "true"};
    const json_t *value = journal_read_value_of(r, key);
    if (type == JSON_NULL || json_typeof(value) == type)
        return true;
    return wrong(r, key, "%s: expected %s", key, names[type]);
}

static const key_spec *journal_read_find_key(const line_spec *spec, const char *name)
{
    for (const key_spec *key = spec->keys; key->name; key++)
        if (strcmp(key->name, name) == 0)
            return key;
    return NULL;
}

/* Finds out of what kind a line is, by its key. Complains with a guess when none is known. */
static const line_spec *find_spec(journal_reader *r)
{
    for (size_t i = 0; i < SPECS; i++)
        if (journal_read_value_of(r, specs[i].name))
            return &specs[i];
    nearest guess = {.word = ""};
    for (void *i = json_object_iter(r->object); i; i = json_object_iter_next(r->object, i)) {
        const char *key = json_object_iter_key(i);
        if (is_common(r, key))
            continue;
        guess = (nearest){.word = key};
        for (size_t k = 0; k < SPECS; k++)
            nearest_consider(&guess, specs[k].name);
        break;
    }
    (void)wrong(r, *guess.word ? guess.word : NULL, "this is no line of a journal%s%s%s",
                guess.best ? " (did you mean '" : "", guess.best ? guess.best : "",
                guess.best ? "'?)" : "");
    return NULL;
}

/* Complains about keys that such a line does not have, that are missing, or of a wrong type. */
static bool journal_read_check_keys(journal_reader *r, const line_spec *spec)
{
    for (void *i = json_object_iter(r->object); i; i = json_object_iter_next(r->object, i)) {
        const char *name = json_object_iter_key(i);
        const key_spec *key = journal_read_find_key(spec, name);
        if (is_common(r, name) || strcmp(name, spec->name) == 0 ||
            (strcmp(name, "again") == 0 && spec->kind != JOURNAL_CONFIG))
            continue;
        if (!key)
            return wrong(r, name, "%s: there is no key '%.40s'", spec->name, name);
        if (!check_type(r, name, key->type))
            return false;
    }
    for (const key_spec *key = spec->keys; key->name; key++)
        if (key->required && !journal_read_value_of(r, key->name))
            return wrong(r, NULL, "%s: the key '%s' is missing", spec->name, key->name);
    return check_type(r, spec->name, spec->type);
}

/* Checks the number of a line. Numbers are consecutive, except for the lines lost in a gap. A
 * repeated header or configuration stands before the line of the gap, with the missing numbers
 * before it. */
static bool check_number(journal_reader *r, journal_entry *entry)
{
    uint64_t number = 0;
    if (r->version < JOURNAL_VERSION_SEALS)
        return true;
    if (r->version >= JOURNAL_VERSION_GROUPS && !journal_read_value_of(r, "n")) {
        r->bare++;
        return true;
    }
    if (!journal_read_read_number(r, &number, "n", INT64_MAX))
        return false;
    const uint64_t last = r->last + r->bare;
    const uint64_t missing = r->missing + (number > last ? number - last - 1 : 0);
    const bool again = number <= last;
    r->bare = 0;
    const bool known = r->damaged || journal_read_value_of(r, "gap");
    const bool reported_later = !known && journal_read_value_of(r, "config");
    r->last = number;
    r->damaged = false;
    r->missing = reported_later ? missing : 0;
    entry->missing = missing;
    if (again)
        return wrong(r, "n", "damaged: line number %" PRIu64 " has been there before", number);
    return missing == 0 || known || reported_later ||
           wrong(r, "n", "damaged: %s before this one %s missing",
                 counted(missing, "line").text, missing == 1 ? "is" : "are");
}

/* Returns true for lines that need no seal of their own. */
static bool may_be_bare(const line_spec *spec)
{
    return spec->kind == JOURNAL_SENT || spec->input == INPUT_SEND;
}

/* Checks that the line has a seal where it needs one. A seal of another form, such as one with a
 * digit too few, was not found by check_group(). */
static bool check_seal_of(journal_reader *r, const line_spec *spec)
{
    if (!journal_read_value_of(r, "crc"))
        return may_be_bare(spec) || damaged(r, "no checksum");
    return journal_seal_is_there(r->line, r->length) || damaged(r, "wrong checksum");
}

/* Notes the bus of a configuration. Returns false after a complaint. */
static bool add_bus(journal_reader *r, journal_entry *entry, const char *name)
{
    if (r->known == r->buses)
        return wrong(r, "bus", "bus: there are more configurations than buses, %zu", r->buses);
    r->names[r->known] = strdup(name);
    if (!r->names[r->known])
        return no_memory(r);
    entry->bus = r->known++;
    return true;
}

/* Finds the bus of a line of a rig. Returns false after a complaint. */
static bool read_bus(journal_reader *r, journal_entry *entry)
{
    const char *name = journal_read_text_of(r, "bus");
    if (!name)
        return wrong(r, "bus", "the key 'bus' is missing, or no text");
    for (size_t i = 0; i < r->known; i++) {
        if (strcmp(r->names[i], name) != 0)
            continue;
        entry->bus = i;
        return true;
    }
    if (journal_read_value_of(r, "config"))
        return add_bus(r, entry, name);
    return wrong(r, "bus", "bus: there is no configuration of '%.40s'", name);
}

/* Reads what all lines have in common, then what is special to its kind. */
static bool understand(journal_reader *r, journal_entry *entry)
{
    if (!check_number(r, entry) || (r->buses > 0 && !read_bus(r, entry)))
        return false;
    if (!journal_read_value_of(r, "at"))
        return wrong(r, NULL, "the key 'at' is missing");
    if (!journal_read_read_number(r, &entry->at, "at", INT64_MAX))
        return false;
    const line_spec *spec = find_spec(r);
    if (!spec || !journal_read_check_keys(r, spec))
        return false;
    if (journal_read_value_of(r, "again") && !check_type(r, "again", JSON_TRUE))
        return false;
    if (r->version >= JOURNAL_VERSION_GROUPS && !check_seal_of(r, spec))
        return false;
    entry->kind = spec->kind;
    entry->what.kind = spec->input;
    entry->what.now = entry->at;
    entry->what.advanced = journal_read_value_of(r, "again") != NULL;
    r->tick = entry->at;
    if (journal_read_value_of(r, "sent") &&
        !journal_read_read_number(r, &entry->sent, "sent", INT64_MAX))
        return false;
    return spec->read(r, entry);
}

/* ---- The file -------------------------------------------------------------------------------- */

/* Complains about a file that cannot be read, or a part that cannot be unpacked. */
static bool unreadable(journal_reader *r, const char *problem, bool damaged)
{
    char time[TIME_TEXT_MAX];
    if (!damaged)
        return wrong(r, NULL, "cannot read: %s", problem);
    text_print_seconds(time, r->tick);
    r->torn = true;
    r->failed = false;
    return wrong(r, NULL, "damaged: it cannot be unpacked (%s), byte %" PRIu64
                 " of the file, behind %s s", problem, journal_unpack_place(r->unpacker), time);
}

/* Reads on. Returns false at the end of the file, and after a complaint, which ends the reading. */
static bool read_more(journal_reader *r)
{
    const char *problem;
    bool damaged;
    if (r->at_end)
        return false;
    r->over = true;
    r->failed = true;
    if (buffer_length(&r->bytes) > LINE_BYTES_MAX)
        return wrong(r, NULL, "the line is too long");
    if (!buffer_reserve(&r->bytes, READ_BYTES))
        return no_memory(r);
    ssize_t count = journal_unpack_read(r->unpacker, r->bytes.data + r->bytes.end, READ_BYTES,
                                        &problem, &damaged);
    if (count < 0)
        return unreadable(r, problem, damaged);
    r->over = false;
    r->failed = false;
    r->bytes.end += (size_t)count;
    r->at_end = count == 0;
    return count > 0;
}

/* Finds the line that begins at an offset, reading on for it. Returns false when there is none; an
 * incomplete line does not count. */
static bool find_line(journal_reader *r, size_t offset, size_t *length)
{
    size_t searched = offset;
    for (;;) {
        const size_t end = buffer_length(&r->bytes);
        const char *first = end > searched ? buffer_first(&r->bytes) : NULL;
        const char *found = first ? memchr(first + searched, '\n', end - searched) : NULL;
        if (found) {
            *length = (size_t)(found - first) - offset;
            return true;
        }
        searched = end;
        if (!read_more(r))
            return false;
    }
}

/* Returns true when the seal of the last line of a group is good: for all lines or, where others
 * are lost, for itself. One behind a part that cannot be read cannot be checked. */
static bool is_good(journal_reader *r, const char *line, size_t length, uint32_t crc)
{
    const bool unchecked = r->unchecked;
    r->unchecked = false;
    return unchecked || journal_seal_check(line, length, crc) == JOURNAL_SEAL_GOOD ||
           journal_seal_check(line, length, 0) == JOURNAL_SEAL_GOOD;
}

/* Checks the next lines, up to the first one with a seal. At the end of a file that is cut off some
 * have none. Returns false after a complaint about the file. */
static bool check_group(journal_reader *r)
{
    uint32_t crc = 0;
    size_t length;
    r->group = 0;
    for (size_t lines = 1; find_line(r, r->group, &length); lines++) {
        const char *line = buffer_first(&r->bytes) + r->group;
        r->group += length + 1;
        if (journal_seal_is_there(line, length)) {
            r->lines = is_good(r, line, length, crc) ? 0 : lines;
            return true;
        }
        crc = journal_crc32(crc, line, length + 1);
    }
    return !r->over;
}

/* Leaves the present line, or all lines of a group that is damaged. */
static void leave_line(journal_reader *r)
{
    if (r->line) {
        buffer_take(&r->bytes, r->length + 1);
        r->byte += r->length + 1;
    }
    r->number += r->lines > 0 ? r->lines : 1;
    r->line = NULL;
    r->length = 0;
    r->lines = 0;
}

/* Takes the next line without its end. Returns false when there is none; an incomplete line does
 * not count. Lines that are damaged come as one. */
static bool next_line(journal_reader *r)
{
    const bool grouped = r->version >= JOURNAL_VERSION_GROUPS;
    leave_line(r);
    if (grouped && r->group == 0 && !check_group(r))
        return false;
    if (r->lines > 0)
        r->length = r->group - 1;
    else if (!find_line(r, 0, &r->length))
        return false;
    r->line = buffer_first(&r->bytes);
    r->group -= grouped ? r->length + 1 : 0;
    return true;
}

/* Checks the seal. The header announces seals, but its own is checked before it is read. */
static bool check_seal(journal_reader *r)
{
    if (r->lines > 0)
        return damaged(r, "wrong checksum");
    if (r->version >= JOURNAL_VERSION_GROUPS)
        return true;
    switch (journal_seal_check(r->line, r->length, 0)) {
    case JOURNAL_SEAL_NONE:
        return r->version < JOURNAL_VERSION_SEALS || damaged(r, "no checksum");
    case JOURNAL_SEAL_WRONG:
        return damaged(r, "wrong checksum");
    case JOURNAL_SEAL_GOOD:
        break;
    }
    return true;
}

/* Parses the line as an object; returns false after a complaint. */
static bool parse_line(journal_reader *r)
{
    json_error_t error;
    json_decref(r->object);
    r->object = NULL;
    if (!check_seal(r))
        return false;
    r->object = json_loadb(r->line, r->length, JSON_REJECT_DUPLICATES | JSON_ALLOW_NUL, &error);
    if (json_is_object(r->object))
        return true;
    if (r->object)
        return wrong(r, NULL, "expected an object");
    fprintf(r->errors, "%s:%zu:%d: %s\n", r->file, r->number, error.column > 0 ? error.column : 1,
            error.text);
    return false;
}

/* Reads how many buses the journal is of. */
static bool read_buses(journal_reader *r, unsigned version)
{
    uint64_t buses = 0;
    const bool has = journal_read_value_of(r, "buses");
    if (version < JOURNAL_VERSION_RIG || (version > JOURNAL_VERSION_RIG && !has))
        return true;
    if (!journal_read_read_number(r, &buses, "buses", RIG_BUSES_MAX))
        return false;
    if (buses == 0)
        return wrong(r, "buses", "buses: expected a whole number from 1 to %u", RIG_BUSES_MAX);
    r->buses = (size_t)buses;
    return true;
}

/* Reads the first line, which says the version. A header with a seal is checked by it. */
static bool read_header(journal_reader *r)
{
    static const char none[] = "this is no journal: expected {\"canwire-journal\": ...}";
    uint64_t version = 0;
    if (!next_line(r))
        return !r->over && wrong(r, NULL, "%s", none);
    if (!parse_line(r))
        return false;
    const char *writer = journal_read_text_of(r, "canwire");
    if (!journal_read_value_of(r, "canwire-journal") || !writer)
        return wrong(r, NULL, "%s", none);
    if (!journal_read_read_number(r, &version, "canwire-journal", INT64_MAX))
        return false;
    if (version < 1 || version > JOURNAL_VERSION)
        return wrong(r, "canwire-journal",
                     "version %" PRIu64 " of journals is not known, only 1 to %d", version,
                     JOURNAL_VERSION);
    if (!read_buses(r, (unsigned)version))
        return false;
    const char *bus = journal_read_text_of(r, "bus");
    const char *started = journal_read_text_of(r, "started");
    r->writer = strdup(writer);
    r->bus = strdup(bus ? bus : "");
    r->started = strdup(started ? started : "");
    if (!r->writer || !r->bus || !r->started)
        return no_memory(r);
    if (version < JOURNAL_VERSION_SEALS) {
        r->version = (unsigned)version;
        return true;
    }
    r->version = JOURNAL_VERSION_SEALS; /* the header has a seal of its own */
    if (!check_seal(r) || !journal_read_read_number(r, &r->last, "n", INT64_MAX))
        return false;
    r->version = (unsigned)version;
    r->missing = r->last > 0 ? r->last - 1 : 0;
    return true;
}

journal_reader *journal_open(const char *file, FILE *errors)
{
    int fd = open(file, O_RDONLY | O_CLOEXEC);
    if (fd < 0) {
        fprintf(errors, "%s: %s\n", file, strerror(errno));
        return NULL;
    }
    journal_reader *r = calloc(1, sizeof *r);
    if (!r) {
        fprintf(errors, "%s: out of memory\n", file);
        (void)close(fd);
        return NULL;
    }
    *r = (journal_reader){.file = file, .errors = errors, .fd = fd};
    r->unpacker = journal_unpack(fd);
    if (r->unpacker ? read_header(r) : no_memory(r))
        return r;
    journal_close(r);
    return NULL;
}

void journal_close(journal_reader *r)
{
    if (!r)
        return;
    (void)close(r->fd);
    journal_unpack_end(r->unpacker);
    json_decref(r->object);
    arena_free(&r->arena);
    buffer_free(&r->bytes);
    for (size_t i = 0; i < r->known; i++)
        free(r->names[i]);
    free(r->writer);
    free(r->bus);
    free(r->started);
    free(r);
}

const char *journal_writer(const journal_reader *r)
{
    return r->writer;
}

void journal_next(journal_reader *r, journal_entry *entry)
{
    *entry = (journal_entry){.kind = JOURNAL_BAD};
    arena_free(&r->arena);
    if (r->over)
        return;
    if (next_line(r)) {
        if (!parse_line(r) || !understand(r, entry))
            entry->kind = JOURNAL_BAD;
    } else if (!r->over) {
        entry->kind = JOURNAL_CUT;
    }
    r->ended += entry->kind == JOURNAL_END;
    const bool all_ended = entry->kind == JOURNAL_END && r->ended >= r->buses;
    r->over = all_ended || entry->kind == JOURNAL_BROKEN || entry->kind == JOURNAL_CUT ||
              entry->kind == JOURNAL_BAD;
    entry->last = r->over;
}

/* Goes on with the first line that begins behind a part that cannot be unpacked. */
static void go_on_behind(journal_reader *r)
{
    size_t length;
    buffer_clear(&r->bytes);
    r->line = NULL;
    r->group = 0;
    r->torn = false;
    r->damaged = true;
    r->unchecked = true;
    if (!r->over && find_line(r, 0, &length))
        buffer_take(&r->bytes, length + 1);
}

bool journal_go_on(journal_reader *r)
{
    r->over = r->failed || (r->torn && !journal_unpack_go_on(r->unpacker));
    if (r->torn)
        go_on_behind(r);
    return !r->over;
}

bool journal_is_at_end(journal_reader *r)
{
    return buffer_length(&r->bytes) <= r->length + (r->line != NULL) && !read_more(r) &&
           r->at_end;
}

size_t journal_line(const journal_reader *r)
{
    return r->number;
}

uint64_t journal_byte(const journal_reader *r)
{
    return r->byte;
}

unsigned journal_version(const journal_reader *r)
{
    return r->version;
}

size_t journal_buses(const journal_reader *r)
{
    return r->buses;
}

bool journal_is_of_rig(const char *file)
{
    struct stat found;
    if (stat(file, &found) != 0 || !S_ISREG(found.st_mode)) /* a pipe can be read only once */
        return false;
    memo unread; /* somebody else reads the same file, and complains */
    journal_reader *r = memo_begin(&unread) ? journal_open(file, unread.out) : NULL;
    const bool is = r && r->buses > 0;
    journal_close(r);
    memo_end(&unread);
    return is;
}

const char *journal_bus(const journal_reader *r)
{
    return r->bus;
}

const char *journal_started(const journal_reader *r)
{
    return r->started;
}
