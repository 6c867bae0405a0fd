/* SPDX-License-Identifier: MIT
 *
 * shard.c - the part of the rows that one of several runs does.
 */
#include "campaign/shard.h"

#include "base/text/counted.h"
#include "base/text/number.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define NUMBER_MAX 24
#define SHARDS_MAX 1000000u

static bool is_good(const shard *s)
{
    return s->n >= 1 && s->n <= SHARDS_MAX && s->k >= 1 && s->k <= s->n;
}

bool shard_parse(shard *out, const char *text)
{
    char first[NUMBER_MAX];
    const char *slash = strchr(text, '/');
    const size_t length = slash ? (size_t)(slash - text) : NUMBER_MAX;
    if (length >= NUMBER_MAX)
        return false;
    memcpy(first, text, length);
    first[length] = '\0';
    return !text_parse_uint(&out->k, first) && !text_parse_uint(&out->n, slash + 1) &&
           is_good(out);
}

/* ---- The environment ------------------------------------------------------------------------- */

/* Variables with the number of a part, from `from` on, and the number of parts. */
typedef struct source {
    const char *index;
    const char *count;
    uint64_t from;
} source;

static const source sources[] = {
    {"SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT", 0},
    {"JOB_COMPLETION_INDEX", "JOB_COMPLETIONS", 0},
    {"CI_NODE_INDEX", "CI_NODE_TOTAL", 1},
};

static bool shard_refuse(char problem[SHARD_PROBLEM_MAX], const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* Writes the reason, and returns false for its caller to return. */
static bool shard_refuse(char problem[SHARD_PROBLEM_MAX], const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    (void)vsnprintf(problem, SHARD_PROBLEM_MAX, format, arguments);
    va_end(arguments);
    return false;
}

/* Reads a variable that must be there. */
static bool read_variable(uint64_t *out, const char *name, const char *reason,
                          char problem[SHARD_PROBLEM_MAX])
{
    const char *text = getenv(name);
    if (!text)
        return shard_refuse(problem, "%s is missing in the environment, which has %s", name,
                            reason);
    return !text_parse_uint(out, text) ||
           shard_refuse(problem, "%s=%.24s in the environment is no number", name, text);
}

/* Reads the indices of an array of Slurm. Those of a whole one are all numbers from 0 or 1 on.
 * Others are of tasks that were submitted again, and nothing says how many parts there are. */
static bool read_array(source *s, char problem[SHARD_PROBLEM_MAX])
{
    static const char least[] = "SLURM_ARRAY_TASK_MIN";
    static const char most[] = "SLURM_ARRAY_TASK_MAX";
    uint64_t count;
    uint64_t max;
    if (!read_variable(&count, s->count, s->index, problem) ||
        !read_variable(&s->from, least, s->index, problem) ||
        !read_variable(&max, most, s->index, problem))
        return false;
    if (s->from <= 1 && max >= s->from && max - s->from + 1 == count && count > 1)
        return true;
    return shard_refuse(problem,
                        "%s to %s are %" PRIu64 " to %" PRIu64 ", with %s: that may be a part "
                        "of an array",
                        least, most, s->from, max, counted(count, "task").text);
}

/* Reads the part from the variables of one system. The number of the first part differs between
 * systems. */
static bool read_source(shard *out, source s, char problem[SHARD_PROBLEM_MAX])
{
    uint64_t index;
    const bool is_array = s.index == sources[0].index;
    if (!read_variable(&index, s.index, s.count, problem) ||
        !read_variable(&out->n, s.count, s.index, problem) ||
        (is_array && !read_array(&s, problem)))
        return false;
    out->k = index - s.from + 1;
    return (index >= s.from && is_good(out)) ||
           shard_refuse(problem,
                        "%s=%" PRIu64 " in the environment is none of %s=%" PRIu64 ", from %" PRIu64
                        " on",
                        s.index, index, s.count, out->n, s.from);
}

bool shard_find(shard *out, char problem[SHARD_PROBLEM_MAX])
{
    *out = (shard){.k = 1, .n = 1};
    for (size_t i = 0; i < sizeof sources / sizeof *sources; i++)
        if (getenv(sources[i].index))
            return read_source(out, sources[i], problem);
    return true;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

uint64_t shard_begin(const shard *s, uint64_t k, uint64_t rows)
{
    const uint64_t before = k - 1;
    const uint64_t rest = rows % s->n;
    return rows / s->n * before + (before < rest ? before : rest);
}
