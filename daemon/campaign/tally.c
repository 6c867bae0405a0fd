/* SPDX-License-Identifier: MIT
 *
 * tally.c - counts the outcomes of scenarios.
 */
#include "campaign/tally.h"

#include "base/text/plain.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/wait.h>

/* Returns true for a row that has nothing between an empty list of losses and its last key. That
 * key stands behind the last comma, unless a command has commas. */
static bool has_no_notes(const char *row, size_t length)
{
    static const char end[] = "\"lost\":[],\"repeat\":";
    const size_t before = strlen("\"lost\":[]");
    const char *comma = memrchr(row, ',', length);
    const size_t at = comma ? (size_t)(comma - row) : 0;
    return at >= before && length - at > strlen(end) - before &&
           memcmp(comma - before, end, strlen(end)) == 0;
}

const char *tally_first_note(const char *row, size_t length)
{
    static const char key[] = ",\"notes\":[\"";
    if (has_no_notes(row, length))
        return NULL;
    const char *found = memmem(row, length, key, sizeof key - 1);
    return found ? found + sizeof key - 1 : NULL;
}

void tally_add(tally *t, const char *program, outcome o, const char *row, size_t length)
{
    const char *note = tally_first_note(row, length);
    t->count[o]++;
    if (!note || t->noted++ > 0)
        return;
    plain_print(stderr, "%s: %.*s\n", program, (int)strcspn(note, "\""), note);
}

uint64_t tally_total(const tally *t)
{
    uint64_t total = 0;
    for (unsigned i = 0; i < OUTCOME_COUNT; i++)
        total += t->count[i];
    return total;
}

bool tally_has_bad(const tally *t)
{
    return t->count[OUTCOME_BROKEN] > 0 || t->count[OUTCOME_INVALID] > 0;
}

bool tally_all_passed(const tally *t)
{
    return t->count[OUTCOME_PASSED] == tally_total(t);
}

void tally_print(FILE *out, const tally *t)
{
    fprintf(out, "%" PRIu64 " %s", t->count[OUTCOME_PASSED], outcome_name(OUTCOME_PASSED));
    for (unsigned i = OUTCOME_PASSED + 1; i < OUTCOME_COUNT; i++)
        if (t->count[i] > 0)
            fprintf(out, ", %" PRIu64 " %s", t->count[i], outcome_name((outcome)i));
    if (t->noted > 0)
        fprintf(out, "; %" PRIu64 " with notes", t->noted);
}

outcome tally_lost(buffer *row, const pool_loss *loss)
{
    char why[64] = "";
    const outcome o = loss->timeout ? OUTCOME_TIMEOUT : OUTCOME_CRASHED;
    if (!loss->timeout && WIFSIGNALED(loss->status))
        (void)snprintf(why, sizeof why, "signal %s", sigabbrev_np(WTERMSIG(loss->status)));
    else if (!loss->timeout && WEXITSTATUS(loss->status) == POOL_EXIT_SHORT)
        (void)snprintf(why, sizeof why, "memory or descriptors were short");
    else if (!loss->timeout)
        (void)snprintf(why, sizeof why, "exit status %d", WEXITSTATUS(loss->status));
    outcome_write_none(row, o, why);
    return o;
}
