/* SPDX-License-Identifier: MIT
 *
 * class.c - the class of a row: what a scenario has shown, for the statistics of a campaign.
 */
#include "campaign/space/class.h"

/* Errors count from the first hit of a rule on, or from the start where no rule has acted. */
static bool is_seen(const class_facts *f)
{
    return f->announced || (f->hit ? f->error_after_hit : f->error);
}

/* A failure that nothing has shown is the worst class: a system would not have reacted. */
static row_class class_of_result(const class_facts *f)
{
    if (f->failed)
        return is_seen(f) ? CLASS_DETECTED : CLASS_UNDETECTED;
    if (f->degraded)
        return CLASS_DEGRADED;
    return f->error ? CLASS_CORRECTED : CLASS_NO_EFFECT;
}

/* The process decides first: one that has crashed has no result to judge. */
row_class class_of(const class_facts *f)
{
    switch (f->outcome) {
    case OUTCOME_TIMEOUT:
        return CLASS_TIMEOUT;
    case OUTCOME_CRASHED:
        return CLASS_CRASHED;
    case OUTCOME_INVALID:
        return CLASS_INVALID;
    case OUTCOME_PASSED:
    case OUTCOME_FAILED:
        return class_of_result(f);
    case OUTCOME_BROKEN:
    case OUTCOME_COUNT:
        break;
    }
    return CLASS_BROKEN;
}

const char *class_name(row_class c)
{
    static const char *const names[CLASS_COUNT] = {
        [CLASS_NO_EFFECT] = "no effect",
        [CLASS_CORRECTED] = "corrected by retransmission",
        [CLASS_DEGRADED] = "degraded",
        [CLASS_DETECTED] = "expectation failed but detected",
        [CLASS_UNDETECTED] = "failed undetected",
        [CLASS_TIMEOUT] = "time-out",
        [CLASS_CRASHED] = "crashed",
        [CLASS_INVALID] = "invalid",
        [CLASS_BROKEN] = "broken",
    };
    return names[c];
}

const char *class_reason_name(unsigned i)
{
    static const char *const names[DEGRADED_REASONS] = {
        "error-passive", "bus-off", "not error-active in the end", "dropped frame",
        "undetected error",
    };
    return names[i];
}
