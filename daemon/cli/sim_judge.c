/* SPDX-License-Identifier: MIT
 *
 * sim_judge.c - judges a run of `canwire sim` by what its configuration expects, and reports.
 */
#include "sim_judge.h"

static bool fail(void)
{
    fprintf(stderr, "canwire sim: out of memory\n");
    return false;
}

static void judge_event(void *user, const cw_event *event)
{
    expect_event(user, event);
}

bool sim_judge_start(sim_judge *j, sim_run *run)
{
    if (run->config->expect_count == 0)
        return true;
    j->judge = expect_start(run->config);
    if (!j->judge)
        return fail();
    const sim_sink sink = {.user = j->judge, .event = judge_event};
    sim_add_sink(run, &sink);
    return true;
}

bool sim_judge_finish(sim_judge *j, const sim_run *run)
{
    if (j->judge && !expect_conclude(j->judge, &j->report, run->bus))
        return fail();
    if (j->judge)
        expect_report_text(j->to_stderr ? stderr : stdout, &j->report);
    if (j->junit)
        expect_report_junit(j->junit, &j->report, run->config->bus_name, cw_bus_now(run->bus));
    return true;
}

void sim_judge_close(sim_judge *j)
{
    expect_free(j->judge);
    expect_report_free(&j->report);
}
