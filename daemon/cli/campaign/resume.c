/* SPDX-License-Identifier: MIT
 *
 * resume.c - the rows that an earlier run has left: are they those of this campaign?
 */
#include "cli/campaign/resume.h"

#include "base/plain.h"

#include <errno.h>
#include <inttypes.h>
#include <string.h>

/* A row that is made again. */
typedef struct repeated {
    const resume *resume;
    const resume_row *row;
    bool lost; /* it has made none */
    bool same;
} repeated;

/* ---- Rows ------------------------------------------------------------------------------------ */

static bool is_same(const rowtext *text, const char *line, size_t length)
{
    return !text->no_memory && buffer_length(&text->bytes) == length &&
           memcmp(buffer_first(&text->bytes), line, length) == 0;
}

static void keep(resume_row *row, uint64_t number, const char *line, size_t length)
{
    rowtext_clear(&row->line);
    row->number = number;
    if (!buffer_append(&row->line.bytes, line, length))
        row->line.no_memory = true;
}

/* A crash and a time-out may be those of the machine. */
static bool can_repeat(outcome o)
{
    return o != OUTCOME_CRASHED && o != OUTCOME_TIMEOUT;
}

/* Finds the outcome that begins a text. Returns false without one. */
static bool find_outcome(outcome *out, const char *text, size_t length)
{
    for (unsigned i = 0; i < OUTCOME_COUNT; i++) {
        const char *name = outcome_name((outcome)i);
        const size_t size = strlen(name);
        if (length <= size || memcmp(text, name, size) != 0 || text[size] != '"')
            continue;
        *out = (outcome)i;
        return true;
    }
    return false;
}

static void count_row(resume *r, outcome o, const char *line, size_t length)
{
    const uint64_t number = r->first + r->there++;
    if ((o == OUTCOME_INVALID || o == OUTCOME_BROKEN) && r->bad == UINT64_MAX)
        r->bad = number;
    r->tally.count[o]++;
    if (!can_repeat(o) || r->campaign->ecus.count > 0) /* real time differs from run to run */
        return;
    const bool first = buffer_length(&r->checked[0].line.bytes) == 0;
    keep(&r->checked[first ? 0 : 1], number, line, length);
}

bool resume_take(resume *r, const char *line, size_t length)
{
    rowtext head = {.no_memory = false};
    outcome o;
    if (r->there == r->count)
        return false;
    runner_head(r->runner, r->first + r->there, &head);
    const size_t size = buffer_length(&head.bytes);
    const bool good = !head.no_memory && length > size &&
                      memcmp(line, buffer_first(&head.bytes), size) == 0 &&
                      find_outcome(&o, line + size, length - size);
    rowtext_free(&head);
    if (good)
        count_row(r, o, line, length);
    return good;
}

/* ---- Made again ------------------------------------------------------------------------------ */

static unsigned char make(void *user, uint64_t number, rowtext *line)
{
    const repeated *again = user;
    return (unsigned char)runner_row(again->resume->runner, number, line);
}

static unsigned char lose(void *user, uint64_t number, const pool_loss *loss, rowtext *line)
{
    repeated *again = user;
    again->lost = true;
    return (unsigned char)runner_lost(again->resume->runner, number, loss, line);
}

static bool take(void *user, unsigned char code, const char *line, size_t length)
{
    repeated *again = user;
    (void)code;
    again->same = is_same(&again->row->line, line, length);
    return true;
}

static bool complain(const char *file, const char *what)
{
    plain_print(stderr, "canwire campaign: %s: %s\n", file, what);
    return false;
}

/* Makes a row again in a process of its own. Returns false after a message. */
static bool repeat(const resume *r, const resume_row *row, const char *file)
{
    static const pool_calls calls = {.make = make, .lose = lose, .take = take};
    repeated again = {.resume = r, .row = row};
    const pool_work work = {.calls = &calls, .user = &again, .first = row->number, .count = 1,
                            .jobs = 1, .limit_ms = r->campaign->limit_ms};
    if (row->line.no_memory)
        return complain(file, strerror(ENOMEM));
    if (!pool_run(&work))
        return complain(file, strerror(errno));
    if (again.lost || again.same)
        return true; /* a crash alone does not say that the campaign is another one */
    plain_print(stderr, "canwire campaign: %s: row %" PRIu64 " is another one when it is made "
                "again: the campaign, its scenario, a file that it names, or canwire has changed "
                "since; remove the rows, or leave out --resume\n", file, row->number);
    return false;
}

bool resume_check(resume *r, const char *file)
{
    unsigned count = 0;
    for (; count < 2 && buffer_length(&r->checked[count].line.bytes) > 0; count++)
        if (!repeat(r, &r->checked[count], file))
            return false;
    if (r->there == 0)
        return true;
    plain_print(stderr, "canwire campaign: %s: %" PRIu64 " row%s there%s\n", file, r->there,
                r->there == 1 ? " is" : "s are",
                count == 0   ? ""
                : count == 1 ? "; made again, it is the same"
                             : "; the first and the last one, made again, are the same");
    return true;
}

void resume_free(resume *r)
{
    for (unsigned i = 0; i < 2; i++)
        rowtext_free(&r->checked[i].line);
}
