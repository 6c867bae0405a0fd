/* SPDX-License-Identifier: MIT
 *
 * test_shard.c - the parts of a campaign: by an option, by the environment of a batch system, and
 * their rows.
 */
#include "cases.h"
#include "campaign/shard.h"

#define VARIABLES_MAX 5

/* ---- K/N ------------------------------------------------------------------------------------- */

TEST(a_shard_is_one_of_at_most_a_million)
{
    static const struct {
        const char *text;
        uint64_t k; /* 0: it is refused */
        uint64_t n;
    } cases[] = {
        {"1/1", 1, 1},   {"3/4", 3, 4},       {"1000000/1000000", 1000000, 1000000},
        {"0/4", 0, 0},   {"5/4", 0, 0},       {"1/1000001", 0, 0},
        {"1/0", 0, 0},   {"1", 0, 0},         {"", 0, 0},
        {"/", 0, 0},     {"1/", 0, 0},        {"/4", 0, 0},
        {"1/4/4", 0, 0}, {"-1/4", 0, 0},      {"1 /4", 0, 0},
        {"x/4", 0, 0},   {"1/4x", 0, 0},      {"18446744073709551617/4", 0, 0},
        {"000000000000000000000000001/4", 0, 0},
    };
    for (size_t i = 0; i < COUNT(cases); i++) {
        shard found;
        assert_int_equal(shard_parse(&found, cases[i].text), cases[i].k > 0);
        if (cases[i].k > 0) {
            assert_int_equal(found.k, cases[i].k);
            assert_int_equal(found.n, cases[i].n);
        }
    }
}

/* ---- The environment ------------------------------------------------------------------------- */

#define SLURM(id, count, min, max) \
    {"SLURM_ARRAY_TASK_ID=" id, "SLURM_ARRAY_TASK_COUNT=" count, "SLURM_ARRAY_TASK_MIN=" min, \
     "SLURM_ARRAY_TASK_MAX=" max, "SLURM_ARRAY_TASK_STEP=1"}
#define PART_OF "that may be a part of an array"

typedef struct environment {
    const char *variables[VARIABLES_MAX];
    uint64_t k; /* 0: it is refused, with this in the message */
    uint64_t n;
    const char *message;
} environment;

static const environment environments[] = {
    {{NULL}, 1, 1, NULL},
    /* --array=0-99 and 1-100 */
    {SLURM("0", "100", "0", "99"), 1, 100, NULL},
    {SLURM("99", "100", "0", "99"), 100, 100, NULL},
    {SLURM("1", "100", "1", "100"), 1, 100, NULL},
    {SLURM("100", "100", "1", "100"), 100, 100, NULL},
    /* --array=3,7 and 0,3 and 0-98:2 and 3-5 and 3 and 0: tasks that were submitted again */
    {SLURM("7", "2", "3", "7"), 0, 0, "MAX are 3 to 7, with 2 tasks: " PART_OF},
    {SLURM("3", "2", "0", "3"), 0, 0, "MAX are 0 to 3, with 2 tasks: " PART_OF},
    {SLURM("98", "50", "0", "98"), 0, 0, PART_OF},
    {SLURM("4", "3", "3", "5"), 0, 0, PART_OF},
    {SLURM("3", "1", "3", "3"), 0, 0, "MAX are 3 to 3, with 1 task: " PART_OF},
    {SLURM("0", "1", "0", "0"), 0, 0, PART_OF},
    {SLURM("5", "4", "0", "3"), 0, 0, "SLURM_ARRAY_TASK_ID=5 in the environment is none of "
                                      "SLURM_ARRAY_TASK_COUNT=4, from 0 on"},
    {SLURM("0", "4", "1", "4"), 0, 0, "SLURM_ARRAY_TASK_ID=0 in the environment is none"},
    {SLURM("x", "4", "0", "3"), 0, 0, "SLURM_ARRAY_TASK_ID=x in the environment is no number"},
    {SLURM("1", "", "0", "3"), 0, 0, "SLURM_ARRAY_TASK_COUNT= in the environment is no number"},
    {SLURM("1", "18446744073709551615", "0", "18446744073709551614"), 0, 0, "is none of"},
    {SLURM("1", "0", "0", "18446744073709551615"), 0, 0, PART_OF},
    {{"SLURM_ARRAY_TASK_ID=1"}, 0, 0,
     "SLURM_ARRAY_TASK_COUNT is missing in the environment, which has SLURM_ARRAY_TASK_ID"},
    {{"SLURM_ARRAY_TASK_ID=1", "SLURM_ARRAY_TASK_COUNT=4"}, 0, 0,
     "SLURM_ARRAY_TASK_MIN is missing"},
    {{"JOB_COMPLETION_INDEX=2", "JOB_COMPLETIONS=4"}, 3, 4, NULL},
    {{"JOB_COMPLETION_INDEX=0", "JOB_COMPLETIONS=1"}, 1, 1, NULL},
    {{"JOB_COMPLETION_INDEX=2"}, 0, 0,
     "JOB_COMPLETIONS is missing in the environment, which has JOB_COMPLETION_INDEX"},
    {{"JOB_COMPLETION_INDEX=4", "JOB_COMPLETIONS=4"}, 0, 0, "is none of JOB_COMPLETIONS=4, from 0"},
    {{"JOB_COMPLETION_INDEX=0", "JOB_COMPLETIONS=0"}, 0, 0, "is none of JOB_COMPLETIONS=0"},
    {{"CI_NODE_INDEX=3", "CI_NODE_TOTAL=4"}, 3, 4, NULL},
    {{"CI_NODE_INDEX=0", "CI_NODE_TOTAL=4"}, 0, 0, "is none of CI_NODE_TOTAL=4, from 1 on"},
    {{"CI_NODE_INDEX=1", "CI_NODE_TOTAL=1000001"}, 0, 0, "is none of"},
    {{"CI_NODE_TOTAL=4"}, 1, 1, NULL}, /* a job of GitLab without `parallel` */
};

static void assert_found(const environment *e)
{
    char problem[SHARD_PROBLEM_MAX] = "";
    shard found;
    (void)clearenv();
    for (size_t i = 0; i < VARIABLES_MAX && e->variables[i]; i++) {
        const char *equals = strchr(e->variables[i], '=');
        char name[64];
        (void)snprintf(name, sizeof name, "%.*s", (int)(equals - e->variables[i]), e->variables[i]);
        assert_int_equal(setenv(name, equals + 1, 1), 0);
    }
    assert_int_equal(shard_find(&found, problem), e->k > 0);
    if (e->k == 0) {
        assert_non_null(strstr(problem, e->message));
        return;
    }
    assert_int_equal(found.k, e->k);
    assert_int_equal(found.n, e->n);
}

TEST(the_environment_says_the_shard_or_is_refused)
{
    for (size_t i = 0; i < COUNT(environments); i++)
        assert_found(&environments[i]);
}

/* ---- Rows ------------------------------------------------------------------------------------ */

TEST(the_shards_are_all_rows_in_order_and_of_nearly_one_size)
{
    static const uint64_t rows[] = {0, 1, 2, 5, 99, 100, 101, 1000003, UINT64_C(1) << 62};
    static const uint64_t counts[] = {1, 2, 3, 7, 100, 1000, 1000000};
    for (size_t i = 0; i < COUNT(rows) * COUNT(counts); i++) {
        const uint64_t all = rows[i / COUNT(counts)];
        const shard s = {.k = 1, .n = counts[i % COUNT(counts)]};
        assert_int_equal(shard_begin(&s, 1, all), 0);
        assert_int_equal(shard_begin(&s, s.n + 1, all), all);
        for (uint64_t k = 1; k <= s.n; k++) {
            const uint64_t size = shard_begin(&s, k + 1, all) - shard_begin(&s, k, all);
            assert_true(size == all / s.n || size == all / s.n + 1);
        }
    }
}
