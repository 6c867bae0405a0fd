/* SPDX-License-Identifier: MIT
 *
 * journal_check.c - checks that a journal is whole, and finds its damages.
 */
#include "run/journal_check.h"

#include "base/text/counted.h"
#include "base/text/number.h"
#include "run/journal_read.h"

#include <inttypes.h>

#define DAMAGES_MAX 20u /* that are reported one by one */

typedef struct checker {
    journal_reader *reader;
    const char *file;
    FILE *errors;
    uint64_t lines;
    uint64_t inputs;
    uint64_t gaps;
    uint64_t damages;
    uint64_t tick; /* of the last line */
    uint64_t ticks[RIG_BUSES_MAX]; /* in the same way, of each bus */
    bool ended;
} checker;

/* Tells a problem with the place in the file and the time up to which all is good. */
static void journal_check_complain(checker *c, const char *problem)
{
    char time[TIME_TEXT_MAX];
    text_print_seconds(time, c->tick);
    fprintf(c->errors, "%s:%zu:1: %s (byte %" PRIu64 ", behind %s s)\n", c->file,
            journal_line(c->reader), problem, journal_byte(c->reader), time);
}

/* Counts a gap and tells how long nothing was written. */
static void note_gap(checker *c, const journal_entry *entry)
{
    char begin[TIME_TEXT_MAX];
    char end[TIME_TEXT_MAX];
    if (entry->bus > 0) /* a rig has a line for each bus */
        return;
    text_print_seconds(begin, c->tick);
    text_print_seconds(end, entry->at);
    fprintf(c->errors,
            "%s:%zu:1: nothing was written from %s s to %s s (%s), %" PRIu64
            " lines are missing\n",
            c->file, journal_line(c->reader), begin, end, entry->why, entry->missing);
    c->gaps++;
}

/* Counts a damage. Returns true when the lines behind it are to be read. */
static bool note_damage(checker *c)
{
    c->damages++;
    if (c->damages < DAMAGES_MAX)
        return journal_go_on(c->reader);
    fprintf(c->errors, "%s: this is much damage; the rest is not looked at\n", c->file);
    return false;
}

/* Notes the end, behind which nothing may stand. */
static void note_end(checker *c)
{
    c->ended = true;
    if (journal_is_at_end(c->reader))
        return;
    journal_check_complain(c, "damaged: there is something behind the end");
    c->damages++;
}

/* Checks an entry. Returns true when more may follow. */
static bool check_entry(checker *c, const journal_entry *entry)
{
    switch (entry->kind) {
    case JOURNAL_BAD:
        return note_damage(c);
    case JOURNAL_CUT:
        journal_check_complain(c, "cut off: canwired has not written its end, or still writes");
        return false;
    case JOURNAL_GAP:
        note_gap(c, entry);
        break;
    case JOURNAL_END:
        if (entry->last)
            note_end(c);
        break;
    case JOURNAL_BROKEN:
        journal_check_complain(c, "broken: nothing was written from here on");
        c->gaps++;
        break;
    case JOURNAL_INPUT:
        c->inputs++;
        break;
    case JOURNAL_CONFIG:
    case JOURNAL_MARK:
    case JOURNAL_SENT:
        break;
    }
    c->inputs += entry->sent;
    if (entry->at < c->ticks[entry->bus]) {
        journal_check_complain(c, "damaged: it is before the line above");
        c->damages++;
    }
    c->ticks[entry->bus] = entry->at;
    c->tick = entry->at > c->tick ? entry->at : c->tick;
    c->lines++;
    return !entry->last;
}

/* Prints what was found, on one line. */
static void print_summary(const checker *c, bool good, FILE *out)
{
    char time[TIME_TEXT_MAX];
    text_print_seconds(time, c->tick);
    fprintf(out,
            "%s: %s (bus %s, canwire %s, begun %s: %s, %s, 0 s to %s s, %s",
            c->file, good ? "ok" : "not whole", journal_bus(c->reader), journal_writer(c->reader),
            journal_started(c->reader), counted(c->lines, "line").text,
            counted(c->inputs, "input").text, time,
            c->ended ? "ended" : "without its end");
    if (c->gaps > 0)
        fprintf(out, ", %s", counted(c->gaps, "gap").text);
    if (c->damages > 0)
        fprintf(out, ", damaged at %s", counted(c->damages, "place").text);
    if (journal_version(c->reader) < 2)
        fputs("; it has no checksums, so not all damage is found", out);
    fputs(")\n", out);
}

bool journal_check(const char *file, FILE *out, FILE *errors)
{
    journal_entry entry;
    checker c = {.file = file, .errors = errors, .reader = journal_open(file, errors)};
    if (!c.reader)
        return false;
    c.lines = 1;
    do
        journal_next(c.reader, &entry);
    while (check_entry(&c, &entry));
    bool good = c.ended && c.gaps == 0 && c.damages == 0;
    print_summary(&c, good, out);
    journal_close(c.reader);
    return good;
}
