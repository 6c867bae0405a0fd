/* SPDX-License-Identifier: MIT
 *
 * cases.c - runs the tests of one file.
 */
#include "cases.h"

#include <errno.h>

#define CASES_MAX 1000

static struct CMUnitTest tests[CASES_MAX];
static unsigned lines[CASES_MAX];
static size_t count;
static CMFixtureFunction before_all;
static CMFixtureFunction behind_all;

/* Compilers may call the constructors of a file in any order. */
void cases_add(struct CMUnitTest test, unsigned line)
{
    size_t i = count++;

    if (count > CASES_MAX)
        abort();
    for (; i > 0 && lines[i - 1] > line; i--) {
        tests[i] = tests[i - 1];
        lines[i] = lines[i - 1];
    }
    tests[i] = test;
    lines[i] = line;
}

void cases_frame(CMFixtureFunction before, CMFixtureFunction behind)
{
    before_all = before;
    behind_all = behind;
}

int main(void)
{
    return _cmocka_run_group_tests(program_invocation_short_name, tests, count, before_all,
                                   behind_all);
}
