/* SPDX-License-Identifier: MIT
 *
 * resume.c - the rows that an earlier run has left: are they those of this campaign?
 */
#include "cli/campaign/resume.h"

#include "base/text/counted.h"
#include "base/text/plain.h"

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

static bool resume_is_same(const buffer *text, const char *line, size_t length)
{
    return !text->no_memory && buffer_length(text) == length &&
           memcmp(buffer_first(text), line, length) == 0;
}

static void resume_keep(resume_row *row, uint64_t number, const char *line, size_t length)
{
    buffer_clear(&row->line);
    row->number = number;
    (void)buffer_append(&row->line, line, length);
}

/* Leaves out every second row of those that are spread. */
static void thin_out(resume *r)
{
    for (unsigned i = 1; 2 * i < r->spread_count; i++) {
        const resume_row row = r->spread[i];
        r->spread[i] = r->spread[2 * i];
        r->spread[2 * i] = row;
    }
    r->spread_count = (r->spread_count + 1) / 2;
    r->step *= 2;
}

/* Keeps each step-th row. Their number is not known before the last one has come. */
static void spread(resume *r, uint64_t number, const char *line, size_t length)
{
    if (r->step == 0)
        r->step = RESUME_STEP;
    if (r->spread_count == RESUME_SPREAD && r->repeatable % r->step == 0)
        thin_out(r);
    if (r->repeatable % r->step == 0)
        resume_keep(&r->spread[r->spread_count++], number, line, length);
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

/* Counts a row of the file, and chooses rows to make again: a sample from all of them, and the last
 * one. */
static void count_row(resume *r, outcome o, const char *line, size_t length)
{
    const uint64_t number = r->first + r->there++;
    if ((o == OUTCOME_INVALID || o == OUTCOME_BROKEN) && r->bad == UINT64_MAX)
        r->bad = number;
    r->tally.count[o]++;
    if (!can_repeat(o) || r->campaign->ecus.count > 0) /* real time differs from run to run */
        return;
    spread(r, number, line, length);
    if (r->repeatable++ > 0)
        resume_keep(&r->last, number, line, length);
}

bool resume_take(resume *r, const char *line, size_t length)
{
    buffer head = {.data = NULL};
    outcome o;
    if (r->there == r->count)
        return false;
    runner_head(r->runner, r->first + r->there, &head);
    const size_t size = buffer_length(&head);
    const bool good = !head.no_memory && length > size &&
                      memcmp(line, buffer_first(&head), size) == 0 &&
                      find_outcome(&o, line + size, length - size);
    buffer_free(&head);
    if (good)
        count_row(r, o, line, length);
    return good;
}

/* ---- Made again ------------------------------------------------------------------------------ */

static unsigned char resume_make(void *user, uint64_t number, buffer *line)
{
    const repeated *again = user;
    return (unsigned char)runner_row(again->resume->runner, number, line);
}

static unsigned char resume_lose(void *user, uint64_t number, const pool_loss *loss, buffer *line)
{
    repeated *again = user;
    again->lost = true;
    return (unsigned char)runner_lost(again->resume->runner, number, loss, line);
}

/* Compares a row that was made again with that of the file. */
static bool campaign_resume_take(void *user, unsigned char code, const char *line, size_t length)
{
    repeated *again = user;
    (void)code;
    again->same = resume_is_same(&again->row->line, line, length);
    return true;
}

static bool resume_complain(const char *file, const char *what)
{
    plain_print(stderr, "canwire campaign: %s: %s\n", file, what);
    return false;
}

/* Makes a row again in a process of its own. Returns false after a message. */
static bool repeat(const resume *r, const resume_row *row, const char *file)
{
    static const pool_calls calls = {
        .make = resume_make, .lose = resume_lose, .take = campaign_resume_take};
    repeated again = {.resume = r, .row = row};
    const pool_work work = {.calls = &calls, .user = &again, .first = row->number, .count = 1,
                            .jobs = 1, .limit_ms = r->campaign->limit_ms};
    if (row->line.no_memory)
        return resume_complain(file, strerror(ENOMEM));
    if (!pool_run(&work))
        return resume_complain(file, strerror(errno));
    if (again.lost || again.same)
        return true; /* a crash alone does not say that the campaign is another one */
    plain_print(stderr, "canwire campaign: %s: row %" PRIu64 " is another one when it is made "
                "again: the campaign, its scenario, a file that it names, or canwire has changed "
                "since; remove the rows, or leave out --resume\n", file, row->number);
    return false;
}

/* Returns the row that is made again behind those that are spread, NULL: there is none. */
static const resume_row *last_of(const resume *r)
{
    const bool is_spread = r->spread_count == 0 || r->repeatable == 1 ||
                           r->spread[r->spread_count - 1].number == r->last.number;
    return is_spread ? NULL : &r->last;
}

/* Says how many rows are there, and which of them have been checked. */
static void resume_tell(const resume *r, unsigned made, const char *file)
{
    plain_print(stderr, "canwire campaign: %s: %s %s there", file,
                counted(r->there, "row").text, r->there == 1 ? "is" : "are");
    if (made == 1)
        fputs("; made again, it is the same", stderr);
    if (made == 2)
        fputs("; the first and the last one, made again, are the same", stderr);
    if (made > 2)
        fprintf(stderr, "; the first and the last one and %u between, made again, are the same",
                made - 2);
    fputc('\n', stderr);
}

bool resume_check(resume *r, const char *file)
{
    const resume_row *last = last_of(r);
    for (unsigned i = 0; i < r->spread_count; i++)
        if (!repeat(r, &r->spread[i], file))
            return false;
    if (last && !repeat(r, last, file))
        return false;
    if (r->there > 0)
        resume_tell(r, r->spread_count + (last ? 1 : 0), file);
    return true;
}

void resume_free(resume *r)
{
    for (unsigned i = 0; i < RESUME_SPREAD; i++)
        buffer_free(&r->spread[i].line);
    buffer_free(&r->last.line);
}
