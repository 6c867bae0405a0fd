/* SPDX-License-Identifier: MIT
 *
 * scenario_journal.h - what has become of a bus of canwired, from its journal: a scenario that has
 * been run.
 */
#ifndef CANWIRE_CAMPAIGN_SCENARIO_JOURNAL_H
#define CANWIRE_CAMPAIGN_SCENARIO_JOURNAL_H

#include "campaign/scenario.h"

/* Repeats the run of a journal of one bus, up to a time on it in nanoseconds, UINT64_MAX: to its
 * end. Messages go to `messages`, one a line. Returns NULL after a message when the journal cannot
 * be understood, or without memory. The result is for outcome_write(), not for another run. */
scenario *scenario_replay(const char *file, uint64_t until_ns, FILE *messages);

#endif
