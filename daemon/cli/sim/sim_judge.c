/* SPDX-License-Identifier: MIT
 *
 * sim_judge.c - judges a run of `canwire sim` by its expectations, and reports.
 */
#include "cli/sim/sim_judge.h"

#include "base/text/plain.h"

static bool sim_judge_fail(void)
{
    plain_print(stderr, "canwire sim: out of memory\n");
    return false;
}

static void judge_event(void *user, const cw_event *event)
{
    const sim_judge *j = user;
    if (j->judge)
        expect_event(j->judge, event);
}

void sim_judge_enter(sim_judge *j, const sim_run *run)
{
    cw_bus_stats start;
    j->report.configuration++;
    if (run->config->expect_count == 0)
        return;
    cw_bus_get_stats(run->bus, &start);
    j->judge = expect_start(run->config, &start);
    j->no_memory = j->no_memory || !j->judge;
}

void sim_judge_leave(sim_judge *j, const sim_run *run)
{
    if (j->judge && !expect_conclude(j->judge, &j->report, run->bus))
        j->no_memory = true;
    expect_free(j->judge);
    j->judge = NULL;
}

bool sim_judge_start(sim_judge *j, sim_run *run, bool changes)
{
    const sim_sink sink = {.user = j, .event = judge_event};
    sim_judge_enter(j, run);
    if (j->judge || changes)
        sim_add_sink(run, &sink);
    return !j->no_memory || sim_judge_fail();
}

bool sim_judge_finish(sim_judge *j, const sim_run *run)
{
    bool any = j->judge || j->report.count > 0;
    sim_judge_leave(j, run);
    if (j->no_memory)
        return sim_judge_fail();
    if (any)
        expect_report_text(j->to_stderr ? stderr : stdout, &j->report);
    const expect_suite suite = {.report = &j->report, .bus = run->config->bus_name};
    if (j->junit->stream)
        expect_report_junit(outfile_begin(j->junit), &suite, 1, cw_bus_now(run->bus));
    return true;
}

void sim_judge_close(sim_judge *j)
{
    expect_free(j->judge);
    expect_report_free(&j->report);
}
