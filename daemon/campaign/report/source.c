/* SPDX-License-Identifier: MIT
 *
 * source.c - where rows come from: the command that repeats one.
 */
#include "campaign/report/source.h"

#include "base/text/sametext.h"
#include "campaign/report/memory.h"
#include "campaign/shellword.h"

#include <stdlib.h>
#include <string.h>

/* Returns the next word; "" at the end. */
static const char *next(buffer *word, const char **line)
{
    const bool any = shellword_take(word, line);
    const char *text = memory_seen(word);
    return any ? text : "";
}

/* Reads the rest of a command. Only --until changes the run; the last one counts. */
static void read_options(row_source *out, buffer *word, const char *line)
{
    for (const char *text = next(word, &line); *text; text = next(word, &line)) {
        if (strcmp(text, "--until") != 0)
            continue;
        free(out->until);
        out->until = memory_text(next(word, &line));
    }
}

bool row_source_read(row_source *out, const report_row *row)
{
    const char *line = row->repeat;
    buffer word = {.data = NULL};
    *out = (row_source){.file = NULL};
    bool good = strcmp(next(&word, &line), "canwire") == 0;
    out->is_campaign = good && strcmp(next(&word, &line), "campaign") == 0;
    if (out->is_campaign)
        good = strcmp(next(&word, &line), "run") == 0;
    else
        good = good && strcmp(buffer_first(&word), "sim") == 0;
    const char *file = good ? next(&word, &line) : "";
    good = *file != '\0' && out->is_campaign == row->has_number;
    if (good) {
        out->file = memory_text(file);
        read_options(out, &word, line);
    }
    buffer_free(&word);
    return good;
}

bool row_source_equals(const row_source *a, const row_source *b)
{
    return a->is_campaign == b->is_campaign && same_text(a->file, b->file) &&
           same_text(a->until, b->until);
}

void row_source_free(row_source *s)
{
    free(s->file);
    free(s->until);
    *s = (row_source){.file = NULL};
}
