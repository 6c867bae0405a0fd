/* SPDX-License-Identifier: MIT
 *
 * verdict.c - checks all results: the ends of lives, their files, and their journals, whose runs
 * must be equal to the byte. Frames must be conserved, as seen from outside.
 */
#include "world.h"

#include <dirent.h>
#include <jansson.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#define TURN_MAX_NS (700 * MS) /* CPU time of the event loop between two waits */

static unsigned count;

void verdict(const char *format, ...)
{
    va_list args;
    char text[600];
    va_start(args, format);
    (void)vsnprintf(text, sizeof text, format, args);
    va_end(args);
    if (count++ == 0)
        printf("FAILED seed %llu at %.6f s: %s\n", (unsigned long long)world->seed,
               (double)world->now_ns / 1e9, text);
    world_trace("VERDICT: %s", text);
}

unsigned verdict_count(void)
{
    return count;
}

void verdict_begin(void)
{
    count = 0;
}

/* ---- How a life ended ------------------------------------------------------------------------ */

static void check_log(int life)
{
    static const char *const bad[] = {"AddressSanitizer", "LeakSanitizer", "runtime error:",
                                      "unaccounted",      "Assertion",     "UndefinedBehavior"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        if (life_log_has(life, bad[i])) {
            verdict("the log of life %d says '%s'", life, bad[i]);
            return;
        }
}

static void check_status(int life)
{
    const world_life *l = &world->lives[life];
    if (l->killed)
        return;
    if (WIFSIGNALED(l->status)) {
        bool before_watching = !l->started_up && l->stop_ns != NEVER;
        if (!before_watching)
            verdict("life %d is ended by signal %d", life, WTERMSIG(l->status));
    } else if (WEXITSTATUS(l->status) != 0) {
        if (l->started_up || !(l->may_fail || l->disk_failed || l->faulted))
            verdict("life %d ends with status %d", life, WEXITSTATUS(l->status));
    } else if (l->stop_ns == NEVER) {
        verdict("life %d ends although nobody told it to", life);
    }
}

void verdict_life_ended(int life)
{
    const world_life *l = &world->lives[life];
    if (l->complaint[0])
        verdict("life %d: %s", life, l->complaint);
    check_log(life);
    check_status(life);
    if (l->longest_turn_ns > TURN_MAX_NS)
        verdict("life %d works for %lld ms between two waits of its event loop", life,
                (long long)(l->longest_turn_ns / MS));
}

/* ---- Journals -------------------------------------------------------------------------------- */

static int life_of_journal(const char *name)
{
    uint64_t file = file_identity(name);
    for (int i = 0; file && i < (int)world->life_count; i++)
        if (world->lives[i].journal == file)
            return i;
    return -1;
}

static size_t line_length(const char *at)
{
    size_t length = strcspn(at, "\n");
    return length + (at[length] == '\n');
}

/* Returns true for messages of the daemon that the simulation lacks. */
static bool is_foreign(const char *line)
{
    return strncmp(line, "{\"ok\"", 5) == 0 || strncmp(line, "{\"lost\"", 7) == 0 ||
           strstr(line, "\"event\":\"record\"") != NULL; /* of a copy: a line */
}

/* Returns the next watched line of events, from *at on; NULL: no more whole lines. */
static const char *next_watched(const char **at, size_t *length, bool *gap)
{
    while (**at) {
        const char *line = *at;
        *length = line_length(line);
        if (line[*length - 1] != '\n')
            return NULL;
        *at += *length;
        char copy[400];
        (void)snprintf(copy, sizeof copy, "%.*s", (int)*length, line);
        if (!is_foreign(copy))
            return line;
        *gap = *gap || strncmp(line, "{\"lost\"", 7) == 0 || strncmp(line, "{\"ok\"", 5) == 0;
    }
    return NULL;
}

/* Finds the watched lines in the events of the journal: the first anywhere, the next ones, without
 * a loss, directly behind it. A journal that breaks off has no more lines to compare. */
static void compare_watched(const resim *run, int life, bool whole)
{
    size_t size, length;
    const char *at = client_watched(life, &size);
    const char *events = run->events;
    bool gap = true;
    const char *line;
    unsigned long compared = 0;
    while (at && (line = next_watched(&at, &length, &gap)) != NULL) {
        while (gap && *events && strncmp(events, line, length) != 0)
            events += line_length(events);
        if (*events == '\0') {
            if (whole && (!gap || compared == 0))
                verdict("the journal of life %d does not have the event %.*s", life,
                        (int)length - 1, line);
            break;
        }
        if (strncmp(events, line, length) != 0) {
            if (whole || events[line_length(events) - 1] == '\n')
                verdict("the journal of life %d has %.*s where the daemon had %.*s", life,
                        (int)line_length(events) - 1, events, (int)length - 1, line);
            break;
        }
        events += length;
        gap = false;
        compared++;
    }
    world_trace("%lu events of life %d are those of its journal", compared, life);
}

/* Returns the frames that a node received according to the journal, in the form of ecu_seen. */
static char *received_by(const char *events, unsigned ecu)
{
    char node[64];
    char *out = NULL;
    size_t size;
    FILE *stream = open_memstream(&out, &size);
    (void)snprintf(node, sizeof node, "\"node\":\"e%u\",\"event\":\"rx\"", ecu);
    for (const char *at = events; *at; at += line_length(at)) {
        const char *found = memmem(at, line_length(at), node, strlen(node));
        const char *frame = found ? memmem(found, line_length(found), "\"frame\":\"", 9) : NULL;
        if (frame)
            fprintf(stream, "%.*s\n", (int)strcspn(frame + 9, "\""), frame + 9);
    }
    (void)fclose(stream);
    return out;
}

/* Returns true for a frame of an ECU: each has a number, by which it is found. */
static bool has_number(const char *frame)
{
    return *frame >= '1' && *frame <= '0' + (int)ECUS_MAX;
}

static const char *numbered(const char *at)
{
    while (*at && !has_number(at))
        at += line_length(at);
    return at;
}

/* Compares frames in order; a steady ECU got all of them, another one some. */
static void compare_received(const resim *run, int life, unsigned ecu, bool whole)
{
    const ecu_seen *seen = ecu_seen_of(ecu, life);
    bool all = seen->steady && !world->lives[life].faulted;
    if (!seen->text)
        return;
    char *expected = received_by(run->events, ecu);
    const char *e = expected, *s = seen->text;
    bool first = true;
    while (*(s = numbered(s)) && *(e = numbered(e))) {
        size_t length = line_length(s);
        bool same = length == line_length(e) && strncmp(s, e, length) == 0;
        /* a rule may have doubled the frame that it began with, before it was there */
        bool again = strncmp(e, seen->text, line_length(e)) == 0;
        if (!same && all && !first && !again) {
            verdict("ECU %u of life %d got %.*s where the bus has %.*s", ecu, life, (int)length - 1,
                    s, (int)line_length(e) - 1, e);
            break;
        }
        first = first && !same; /* it connected when the bus was running */
        e += line_length(e);
        s += same ? length : 0;
    }
    e = numbered(e);
    if (*s && whole && count == 0)
        verdict("ECU %u of life %d got %.*s, which its node has not received", ecu, life,
                (int)line_length(s) - 1, s);
    if (*e && whole && all && !first && count == 0)
        verdict("ECU %u of life %d did not get %.*s", ecu, life, (int)line_length(e) - 1, e);
    free(expected);
}

static bool ended_well(int life)
{
    const world_life *l = &world->lives[life];
    return !l->killed && WIFEXITED(l->status) && WEXITSTATUS(l->status) == 0;
}

static void check_journal(const char *name)
{
    int life = life_of_journal(name);
    resim run;
    if (life < 0)
        return;
    const world_life *l = &world->lives[life];
    bool whole = ended_well(life) && !l->disk_failed;
    resim_run(&run, name);
    world_trace("the journal %s of life %d: status %d", name, life, run.status);
    if (run.crashed)
        verdict("canwire sim --journal crashes with %s of life %d: %.200s", name, life, run.errors);
    else if (whole && run.status != 0)
        verdict("the journal of life %d does not run again: %.300s", life, run.errors);
    else if (whole && strstr(run.errors, name))
        verdict("the journal of life %d is not whole: %.300s", life, run.errors);
    if (count == 0)
        compare_watched(&run, life, whole);
    for (unsigned i = 0; i < the_story.ecus && count == 0; i++)
        compare_received(&run, life, i, whole);
    resim_free(&run);
}

static int is_journal(const struct dirent *entry)
{
    return strncmp(entry->d_name, "journal", 7) == 0;
}

static void check_journals(void)
{
    struct dirent **entries;
    int found = scandir("log", &entries, is_journal, versionsort);
    for (int i = 0; i < found; i++) {
        char name[300];
        (void)snprintf(name, sizeof name, "log/%s", entries[i]->d_name);
        if (count == 0)
            check_journal(name);
        free(entries[i]);
    }
    free(entries);
}

/* Returns true when the journal exists. A life that ended without its last messages has one, unless
 * a later life has reported its removal. */
static bool journal_is_there(uint64_t file)
{
    struct dirent **entries;
    bool there = false;
    int found = scandir("log", &entries, is_journal, versionsort);
    for (int i = 0; i < found; i++) {
        char name[300];
        (void)snprintf(name, sizeof name, "log/%s", entries[i]->d_name);
        there = there || file_identity(name) == file;
        free(entries[i]);
    }
    free(entries);
    return there;
}

static bool journal_was_told(int life)
{
    for (int i = life + 1; i < (int)world->life_count; i++)
        if (life_log_has(i, "has no end"))
            return true;
    return false;
}

static void check_evidence(void)
{
    for (int i = 0; i < (int)world->life_count; i++) {
        const world_life *l = &world->lives[i];
        if (l->journal == 0 || ended_well(i) || journal_is_there(l->journal))
            continue;
        if (!journal_was_told(i))
            verdict("the journal of life %d, which crashed, has been removed without a word", i);
    }
}

/* ---- Books ----------------------------------------------------------------------------------- */

static uint64_t number_in(const json_t *object, const char *key)
{
    return (uint64_t)json_integer_value(json_object_get(object, key));
}

/* all_sent: the bus has no frames left, so all frames have been read. */
static void check_books_of(const json_t *node, unsigned ecu, int life, bool all_sent)
{
    const json_t *interface = json_object_get(node, "interface");
    const ecu_seen *seen = ecu_seen_of(ecu, life);
    const quiet_status *quiet = client_last_status(life);
    if (json_is_false(json_object_get(node, "conserved")))
        verdict("life %d says that frames of e%u are unaccounted for", life, ecu);
    else if (number_in(interface, "read") > seen->sent)
        verdict("life %d has read %llu frames of e%u, which has sent %llu", life,
                (unsigned long long)number_in(interface, "read"), ecu,
                (unsigned long long)seen->sent);
    else if (seen->steady && all_sent && number_in(interface, "read") != seen->sent)
        verdict("life %d has read %llu frames of e%u, which has sent %llu", life,
                (unsigned long long)number_in(interface, "read"), ecu,
                (unsigned long long)seen->sent);
    else if (number_in(interface, "written") < quiet->before[ecu] ||
             (seen->steady && number_in(interface, "written") > quiet->after[ecu]))
        verdict("e%u has got %llu to %llu frames of life %d, which has written %llu", ecu,
                (unsigned long long)quiet->before[ecu], (unsigned long long)quiet->after[ecu], life,
                (unsigned long long)number_in(interface, "written"));
}

static json_t *status_of(int life)
{
    const char *text = client_last_status(life)->text;
    return text ? json_loads(text, 0, NULL) : NULL;
}

/* Checks the life that runs in the end, by its last reply at the control socket. */
static void check_books(int life)
{
    json_t *answer = status_of(life);
    const json_t *nodes = json_object_get(json_object_get(answer, "status"), "nodes");
    const json_t *bus = json_object_get(json_object_get(answer, "status"), "bus");
    for (unsigned i = 0; i < the_story.ecus && nodes && count == 0; i++)
        check_books_of(json_array_get(nodes, i), i, life, number_in(bus, "pending") == 0);
    json_decref(answer);
}

static void check_broken_journal(int life)
{
    json_t *answer = status_of(life);
    const json_t *status = json_object_get(answer, "status");
    const json_t *journal = json_object_get(status, "journal");
    const char *state = json_string_value(json_object_get(journal, "state"));
    bool told = state && (strcmp(state, "broken") == 0 || number_in(journal, "gaps") > 0);
    if (status && life_log_has(life, "broken from") && !told)
        verdict("the journal of life %d has broken, and the status does not tell", life);
    json_decref(answer);
}

void verdict_when_quiet(void)
{
    int life = life_now();
    if (life < 0 || !world->lives[life].started_up)
        return;
    check_books(life);
    check_broken_journal(life);
}

void verdict_at_end(void)
{
    if (count == 0)
        check_evidence();
    if (count == 0)
        check_journals();
}
