/* SPDX-License-Identifier: MIT
 *
 * shard.c - the part of the rows that one of several runs does.
 */
#include "campaign/shard.h"

#include "base/number.h"

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

/* A number of a part and the number of parts in the environment. */
typedef struct source {
    const char *index;
    const char *count;
    const char *least; /* of the index; NULL: `from` */
    uint64_t from;
} source;

static const source sources[] = {
    {"SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT", "SLURM_ARRAY_TASK_MIN", 0},
    {"JOB_COMPLETION_INDEX", "JOB_COMPLETIONS", NULL, 0},
    {"CI_NODE_INDEX", "CI_NODE_TOTAL", NULL, 1},
};

/* Reads a variable. Returns false when it is no number. */
static bool read_variable(uint64_t *out, const char *name)
{
    const char *text = getenv(name);
    return text && !text_parse_uint(out, text);
}

const char *shard_find(shard *out)
{
    *out = (shard){.k = 1, .n = 1};
    for (size_t i = 0; i < sizeof sources / sizeof *sources; i++) {
        const source *s = &sources[i];
        uint64_t index;
        uint64_t least = s->from;
        if (!getenv(s->index))
            continue;
        if (!read_variable(&index, s->index))
            return s->index;
        if (s->least && getenv(s->least) && !read_variable(&least, s->least))
            return s->least;
        if (!read_variable(&out->n, s->count))
            return s->count;
        out->k = index - least + 1;
        return index >= least && is_good(out) ? NULL : s->index;
    }
    return NULL;
}

uint64_t shard_begin(const shard *s, uint64_t k, uint64_t rows)
{
    const uint64_t before = k - 1;
    const uint64_t rest = rows % s->n;
    return rows / s->n * before + (before < rest ? before : rest);
}
