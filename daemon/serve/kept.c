/* SPDX-License-Identifier: MIT
 *
 * kept.c - remembers injected rules beyond the end of the process.
 */
#include "serve/kept.h"

#include "base/text/chars.h"
#include "base/text/counted.h"
#include "base/file/folder.h"
#include "base/file/spool.h"
#include "base/text/jsonput.h"
#include "base/log.h"
#include "base/file/statefile.h"
#include "base/text/memo.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define FORMAT_KEY "canwire-rules"
#define FORMAT 1
#define DATE_BYTES 32
#define TROUBLE_BYTES (4 * KEPT_NOTE_BYTES) /* of notes about crashes, a file, and refusals */
#define WHY_BYTES 200

struct kept {
    statefile *file;
    bool there; /* the file is there, or will be */
    kept_written *told;
    void *user;
    char *path;
    folder folder;    /* of the file: all calls stay there */
    const char *name; /* of the file */
    char *next;       /* becomes it */
    char *bad;        /* a damaged one is moved here */
    char *bus;
    json_t *entries;  /* that are kept: objects with text, name, rules, cleared, refused, why */
    json_t *passing;  /* names of the others */
    json_t *lost;     /* names, or NULL */
    char crashed[DATE_BYTES];
    kept_tally judges;   /* now: a crash would lose it */
    kept_tally unjudged; /* by crashes since the last end in order */
    char unjudged_at[DATE_BYTES];
    char verdicts[KEPT_NOTE_BYTES]; /* the text about these, or "" */
    char note[KEPT_NOTE_BYTES];
    char unread[KEPT_NOTE_BYTES]; /* why those of an earlier file are not injected, or "" */
    char trouble[TROUBLE_BYTES];  /* see kept_trouble() */
    uint64_t forgets; /* the save with which these losses are over; 0: none */
};

/* ---- The file -------------------------------------------------------------------------------- */

/* Puts numbers of expectations, unless there are none. */
static void put_tally(json_t *state, const char *key, const kept_tally *tally, const char *crashed)
{
    if (tally->expectations == 0)
        return;
    json_t *object = json_object();
    put_count(object, "expectations", tally->expectations);
    put_count(object, "failed", tally->failed);
    put_text(object, "crashed", crashed);
    put(state, key, object);
}

/* Returns what the file is to have. Losses by a crash stay in it until somebody has taken note. */
static json_t *state_of(const kept *k)
{
    json_t *state = json_object();
    put_count(state, FORMAT_KEY, FORMAT);
    put_text(state, "bus", k->bus);
    put(state, "kept", json_incref(k->entries));
    put(state, "passing", json_incref(k->passing));
    if (k->lost && !k->forgets) {
        put(state, "lost", json_incref(k->lost));
        put_text(state, "crashed", k->crashed);
    }
    if (*k->unread && !k->forgets)
        put_text(state, "unread", k->unread);
    put_tally(state, "judges", &k->judges, NULL);
    put_tally(state, "unjudged", &k->unjudged, k->unjudged_at);
    return state;
}

static void complain_unwritten(const kept *k, int error)
{
    log_error("rules %s: not written: %s", k->path, spool_explain(error));
}

/* Returns the number of the save, or 0 with an errno. */
static uint64_t put_state(kept *k, bool empty)
{
    if (empty)
        return statefile_put(k->file, NULL);
    json_t *state = state_of(k);
    char *text = json_dumps(state, JSON_COMPACT);
    json_decref(state);
    errno = ENOMEM;
    return text ? statefile_put(k->file, text) : 0;
}

/* Returns true for expectations that a crash would lose, or has lost. */
static bool has_verdicts(const kept *k)
{
    return k->judges.expectations + k->unjudged.expectations > 0;
}

/* Without anything that is to be remembered there is no file. */
uint64_t kept_save(kept *k)
{
    const bool losses = ((k->lost || *k->unread) && !k->forgets) || has_verdicts(k);
    const bool empty = json_array_size(k->entries) + json_array_size(k->passing) == 0 && !losses;
    if (empty && !k->there)
        return 0;
    const uint64_t number = put_state(k, empty);
    if (number == 0)
        complain_unwritten(k, errno);
    else
        k->there = !empty;
    return number;
}

/* Somebody has taken note, by injecting or clearing rules. */
static void forget_losses(kept *k)
{
    json_decref(k->lost);
    k->lost = NULL;
    k->note[0] = k->unread[0] = '\0';
    k->forgets = 0;
}

/* The state has been written, or could not be. Losses are forgotten once the file no longer has
 * them. */
static void on_written(void *user, uint64_t number, int error)
{
    kept *k = user;
    const bool decides = k->forgets && number >= k->forgets;
    if (decides && error == 0)
        forget_losses(k);
    else if (decides)
        k->forgets = 0; /* not by an earlier save: the one that forgets is still to come */
    if (error != 0) {
        k->there = true; /* maybe: the next save tries again */
        complain_unwritten(k, error);
    }
    k->told(k->user, number, error);
}

/* Returns true for a list of texts, which may be empty. */
static bool all_texts(const json_t *array)
{
    bool good = json_is_array(array);
    for (size_t i = 0; i < json_array_size(array); i++)
        good = good && json_is_string(json_array_get(array, i));
    return good;
}

/* Returns true for an entry with all that is needed to inject it again. */
static bool is_entry(const json_t *entry)
{
    return json_is_string(json_object_get(entry, "text")) &&
           json_is_string(json_object_get(entry, "name")) &&
           all_texts(json_object_get(entry, "rules")) &&
           all_texts(json_object_get(entry, "cleared"));
}

/* Returns true also for a state that names no rules that an earlier crash has lost. */
static bool has_good_losses(const json_t *state)
{
    const json_t *lost = json_object_get(state, "lost"),
                 *unread = json_object_get(state, "unread");
    if (unread && !json_is_string(unread))
        return false;
    return !lost || (all_texts(lost) && json_is_string(json_object_get(state, "crashed")));
}

/* Returns the reason why a state is of no use, or NULL. */
static const char *find_fault(const kept *k, const json_t *state)
{
    const json_t *entries = json_object_get(state, "kept");
    const char *bus = get_text(state, "bus");
    if (get_number(state, FORMAT_KEY) != FORMAT || !bus ||
        !json_is_array(entries) || !all_texts(json_object_get(state, "passing")) ||
        !has_good_losses(state))
        return "it is damaged";
    for (size_t i = 0; i < json_array_size(entries); i++)
        if (!is_entry(json_array_get(entries, i)))
            return "it is damaged";
    return strcmp(bus, k->bus) == 0 ? NULL : "it is of another bus";
}

/* Tells of it until rules are injected or cleared, or canwired is stopped. */
static void move_away(kept *k, const char *why)
{
    const bool moved = renameat(k->folder.fd, k->name, k->folder.fd, k->bad) == 0;
    (void)snprintf(k->unread, sizeof k->unread,
                   "rules %.100s: %s; the rules in it are not injected, %s%.100s", k->path, why,
                   moved ? "it is now " : "and it stays: ", moved ? k->bad : strerror(errno));
    log_error("%s", k->unread);
    if (moved)
        (void)kept_save(k);
}

/* ---- A crash --------------------------------------------------------------------------------- */

/* Prints which rules a crash has lost, for the status. */
static void print_note(kept *k)
{
    const size_t count = json_array_size(k->lost);
    size_t used = chars_print(k->note, sizeof k->note, 0, "%s %s lost with the crash at %s",
                              counted(count, "injected rule").text, count == 1 ? "was" : "were",
                              k->crashed);
    for (size_t i = 0; i < count; i++)
        used = chars_print(k->note, sizeof k->note, used, "%s%s", i > 0 ? ", " : ": ",
                           json_string_value(json_array_get(k->lost, i)));
}

static void print_date(char out[DATE_BYTES], const struct stat *file)
{
    struct tm date;
    (void)strftime(out, DATE_BYTES, "%Y-%m-%d %H:%M:%S",
                   localtime_r(&file->st_mtim.tv_sec, &date));
}

static kept_tally get_tally(const json_t *state, const char *key)
{
    const json_t *object = json_object_get(state, key);
    return (kept_tally){.expectations = get_count(object, "expectations"),
                        .failed = get_count(object, "failed")};
}

/* Notes the verdicts that this crash has lost, and earlier ones. */
static void note_verdicts(kept *k, const json_t *state, const struct stat *file)
{
    const kept_tally now = get_tally(state, "judges"), before = get_tally(state, "unjudged");
    k->unjudged = (kept_tally){.expectations = now.expectations + before.expectations,
                               .failed = now.failed + before.failed};
    if (k->unjudged.expectations == 0)
        return;
    if (now.expectations > 0)
        print_date(k->unjudged_at, file);
    else
        (void)snprintf(k->unjudged_at, sizeof k->unjudged_at, "%s",
                       get_any_text(json_object_get(state, "unjudged"), "crashed"));
    (void)snprintf(k->verdicts, sizeof k->verdicts,
                   "%s %s lost with the crash at %s, %" PRIu64 " of them failed",
                   counted(k->unjudged.expectations, "verdict").text,
                   k->unjudged.expectations == 1 ? "was" : "were", k->unjudged_at,
                   k->unjudged.failed);
    log_warning("%s", k->verdicts);
}

/* Notes what this crash has lost, and earlier ones after which nobody has been here. */
static void note_crash(kept *k, const json_t *state, const struct stat *file)
{
    json_t *passing = json_object_get(state, "passing");
    const char *crashed = get_text(state, "crashed");
    json_t *lost = json_array();
    (void)json_array_extend(lost, json_object_get(state, "lost"));
    (void)json_array_extend(lost, passing);
    if (json_array_size(lost) == 0) {
        json_decref(lost);
        return;
    }
    if (json_array_size(passing) > 0 || !crashed)
        print_date(k->crashed, file);
    else
        (void)snprintf(k->crashed, sizeof k->crashed, "%s", crashed);
    k->lost = lost;
    print_note(k);
    log_warning("%s", k->note);
}

/* An earlier start has found it. */
static void note_unread(kept *k, const json_t *state)
{
    const char *unread = get_text(state, "unread");
    (void)snprintf(k->unread, sizeof k->unread, "%s", unread ? unread : "");
    if (*k->unread)
        log_warning("%s", k->unread);
}

/* Reads the state that the last canwired has left. A file that is foreign or damaged is moved
 * away. */
static void kept_read_file(kept *k)
{
    struct stat file;
    const int fd =
        openat(k->folder.fd, k->name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0 && errno == ENOENT)
        return;
    const bool good = fd >= 0 && fstat(fd, &file) == 0 && S_ISREG(file.st_mode);
    const bool foreign = good && file.st_uid != geteuid() && file.st_uid != 0;
    json_t *state = good && !foreign ? json_loadfd(fd, JSON_ALLOW_NUL, NULL) : NULL;
    const char *why = fd < 0    ? strerror(errno)
                      : foreign ? "it belongs to another user"
                                : find_fault(k, state);
    if (fd >= 0)
        (void)close(fd);
    if (why) {
        move_away(k, why);
    } else {
        k->there = true;
        json_decref(k->entries);
        k->entries = json_incref(json_object_get(state, "kept"));
        note_crash(k, state, &file);
        note_verdicts(k, state, &file);
        note_unread(k, state);
        (void)kept_save(k);
    }
    json_decref(state);
}

/* ---- Rules ----------------------------------------------------------------------------------- */

/* Removes a text from a list once. Returns false when it is not there. */
static bool remove_text(json_t *array, const char *text)
{
    for (size_t i = 0; i < json_array_size(array); i++)
        if (strcmp(json_string_value(json_array_get(array, i)), text) == 0)
            return json_array_remove(array, i) == 0;
    return false;
}

/* Clears the rules of a text that had been cleared before the restart. */
static void clear_again(inputs *in, const json_t *entry)
{
    const json_t *cleared = json_object_get(entry, "cleared");
    for (size_t i = 0; i < json_array_size(cleared); i++) {
        unsigned index;
        if (live_find(in->config, &index, json_string_value(json_array_get(cleared, i))))
            inputs_clear(in, index);
    }
}

/* Logs the errors of an entry, and notes the first one. */
static void refuse_entry(json_t *entry, char *errors)
{
    const char *name = get_text(entry, "name");
    char why[WHY_BYTES];
    (void)snprintf(why, sizeof why, "%.*s", (int)strcspn(errors, "\n"), errors);
    put_text(entry, "why", why);
    log_error("rules of %s, which are kept, are refused:", name);
    for (char *line = strtok_r(errors, "\n", &errors); line; line = strtok_r(NULL, "\n", &errors))
        log_error("%s", line);
}

/* Injects a kept text again. When the new configuration refuses it, the entry stays and says
 * why. */
static void apply_entry(inputs *in, json_t *entry)
{
    const json_t *text = json_object_get(entry, "text");
    const char *name = get_text(entry, "name");
    memo errors;
    if (!memo_begin(&errors))
        return;
    cfg_rules *rules =
        inputs_inject(in, json_string_value(text), json_string_length(text), name, errors.out);
    char none[] = "out of memory";
    put_bool(entry, "refused", !rules);
    put(entry, "why", json_null());
    if (rules)
        clear_again(in, entry);
    else
        refuse_entry(entry, memo_text(&errors) ? errors.text : none);
    cfg_free_rules(rules);
    memo_end(&errors);
}

void kept_apply(kept *k, inputs *in)
{
    if (json_array_size(k->passing) > 0) {
        log_info("reload: %s %s gone", counted(json_array_size(k->passing), "injected rule").text,
                 json_array_size(k->passing) == 1 ? "is" : "are");
        (void)json_array_clear(k->passing);
        (void)kept_save(k);
    }
    for (size_t i = 0; i < json_array_size(k->entries); i++)
        apply_entry(in, json_array_get(k->entries, i));
}

uint64_t kept_note(kept *k, const json_t *text, const char *name, const json_t *rules, bool keep)
{
    if (keep) {
        json_t *entry = json_object();
        put_text(entry, "name", name);
        put(entry, "text", json_copy((json_t *)(uintptr_t)text));
        put(entry, "rules", json_copy((json_t *)(uintptr_t)rules));
        put(entry, "cleared", json_array());
        put_last(k->entries, entry);
    }
    for (size_t i = 0; !keep && i < json_array_size(rules); i++)
        put_text_last(k->passing, json_string_value(json_array_get(rules, i)));
    if (!keep)
        forget_losses(k);
    k->forgets = keep; /* in the file; here when that is written */
    const uint64_t save = kept_save(k);
    k->forgets = keep ? save : 0;
    return save;
}

/* Clears a rule of an entry that the bus has refused, or of one that it has not. */
static bool clear_entry(kept *k, const char *rule, bool refused)
{
    for (size_t i = 0; i < json_array_size(k->entries); i++) {
        const json_t *entry = json_array_get(k->entries, i);
        if (json_is_true(json_object_get(entry, "refused")) != refused ||
            !remove_text(json_object_get(entry, "rules"), rule))
            continue;
        put_text_last(json_object_get(entry, "cleared"), rule);
        if (json_array_size(json_object_get(entry, "rules")) == 0)
            (void)json_array_remove(k->entries, i);
        return true;
    }
    return false;
}

/* Those on the bus go first: a refused entry may have a rule of the same name. */
bool kept_take_back(kept *k, const char *rule)
{
    return remove_text(k->passing, rule) || clear_entry(k, rule, false) ||
           clear_entry(k, rule, true);
}

bool kept_clear(kept *k, const char *rule)
{
    if (!kept_take_back(k, rule))
        return false;
    forget_losses(k);
    return true;
}

size_t kept_find(const kept *k, const char *rule)
{
    for (size_t i = 0; i < json_array_size(k->entries); i++) {
        const json_t *entry = json_array_get(k->entries, i);
        if (!json_is_true(json_object_get(entry, "refused")) &&
            json_has_text(json_object_get(entry, "rules"), rule))
            return i + 1;
    }
    return 0;
}

size_t kept_bytes(const kept *k)
{
    size_t sum = 0;
    for (size_t i = 0; i < json_array_size(k->entries); i++)
        sum += json_string_length(json_object_get(json_array_get(k->entries, i), "text"));
    return sum;
}

void kept_clear_all(kept *k, json_t *refused)
{
    for (size_t i = 0; i < json_array_size(k->entries); i++) {
        const json_t *entry = json_array_get(k->entries, i);
        if (json_is_true(json_object_get(entry, "refused")))
            (void)json_array_extend(refused, json_object_get(entry, "rules"));
    }
    forget_losses(k);
    (void)json_array_clear(k->entries);
    (void)json_array_clear(k->passing);
}

/* ---- Start, end, status ---------------------------------------------------------------------- */

/* Writes what is still to be written, and frees all, unless the writing thread hangs. */
static void free_kept(kept *k)
{
    const int error = k->file ? statefile_close(k->file) : 0;
    if (error != 0)
        complain_unwritten(k, error);
    if (error == ETIMEDOUT) /* the thread still uses the names */
        return;
    json_decref(k->entries);
    json_decref(k->passing);
    json_decref(k->lost);
    folder_close(&k->folder);
    free(k->path);
    free(k->next);
    free(k->bad);
    free(k->bus);
    free(k);
}

static char *path_with(const char *path, const char *end)
{
    char *text = NULL;
    return asprintf(&text, "%s%s", path, end) < 0 ? NULL : text;
}

/* Opens the folder and makes the names. Returns 0 or an errno. */
static int open_folder(kept *k, struct ev_loop *loop, const char *control)
{
    k->path = path_with(control, ".rules");
    const int error = k->path ? folder_open(&k->folder, k->path) : ENOMEM;
    if (error != 0)
        return error;
    k->name = k->folder.name;
    k->next = path_with(k->name, ".new");
    k->bad = path_with(k->name, ".bad");
    if (k->next && k->bad)
        k->file = statefile_new(loop, k->folder.fd, k->name, k->next, on_written, k);
    return k->file ? 0 : ENOMEM;
}

kept *kept_open(struct ev_loop *loop, const char *control, const char *bus, kept_written *told,
                void *user)
{
    kept *k = calloc(1, sizeof *k);
    if (!k) {
        log_error("out of memory");
        return NULL;
    }
    *k = (kept){.told = told,
                .user = user,
                .folder = FOLDER_NONE,
                .bus = strdup(bus), /* a reload frees the one of the configuration */
                .entries = json_array(),
                .passing = json_array()};
    const int error = k->bus ? open_folder(k, loop, control) : ENOMEM;
    if (error == 0) {
        kept_read_file(k);
        return k;
    }
    log_warning("rules %s: %s: injected rules are not remembered", k->path ? k->path : control,
                strerror(error));
    free_kept(k);
    return NULL;
}

void kept_judges(kept *k, kept_tally now)
{
    if (k->judges.expectations == now.expectations && k->judges.failed == now.failed)
        return;
    k->judges = now;
    (void)kept_save(k);
}

void kept_live(kept *k)
{
    if (json_array_size(k->passing) > 0 || k->judges.expectations > 0)
        statefile_touch(k->file);
}

const char *kept_trouble(kept *k)
{
    size_t used = chars_print(k->trouble, sizeof k->trouble, 0, "%s%s%s", k->note,
                              *k->note && *k->unread ? "; " : "", k->unread);
    if (*k->verdicts)
        used = chars_print(k->trouble, sizeof k->trouble, used, "%s%s", used > 0 ? "; " : "",
                           k->verdicts);
    for (size_t i = 0; i < json_array_size(k->entries); i++) {
        const json_t *entry = json_array_get(k->entries, i);
        if (json_is_true(json_object_get(entry, "refused")))
            used = chars_print(k->trouble, sizeof k->trouble, used,
                               "%srules of %s are refused: %s", used > 0 ? "; " : "",
                               get_any_text(entry, "name"), get_any_text(entry, "why"));
    }
    return k->trouble;
}

/* Describes an entry for the status, without its text. */
static json_t *kept_json(const json_t *entry)
{
    json_t *object = json_object();
    put(object, "name", json_incref(json_object_get(entry, "name")));
    put(object, "rules", json_incref(json_object_get(entry, "rules")));
    put_bool(object, "refused", json_is_true(json_object_get(entry, "refused")));
    put_text(object, "why", get_text(entry, "why"));
    return object;
}

void kept_put(const kept *k, json_t *status)
{
    json_t *array = json_array();
    for (size_t i = 0; i < json_array_size(k->entries); i++)
        put_last(array, kept_json(json_array_get(k->entries, i)));
    put(status, "kept_rules", array);
    if (*k->unread)
        put_text(status, "unread_rules", k->unread);
    put_tally(status, "lost_verdicts", &k->unjudged, k->unjudged_at);
    if (*k->verdicts)
        put_text(json_object_get(status, "lost_verdicts"), "note", k->verdicts);
    if (!k->lost)
        return;
    json_t *lost = json_object();
    put_text(lost, "crashed", k->crashed);
    put(lost, "rules", json_incref(k->lost));
    put_text(lost, "note", k->note);
    put(status, "lost_rules", lost);
}

void kept_close(kept *k)
{
    if (!k)
        return;
    if (json_array_size(k->passing) > 0 || k->lost || *k->unread || has_verdicts(k)) {
        forget_losses(k);
        k->judges = k->unjudged = (kept_tally){.expectations = 0};
        (void)json_array_clear(k->passing);
        (void)kept_save(k);
    }
    free_kept(k);
}
