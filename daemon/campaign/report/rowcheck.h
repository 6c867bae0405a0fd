/* SPDX-License-Identifier: MIT
 *
 * rowcheck.h - whether the keys of a row with a result have values that canwire writes.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_ROWCHECK_H
#define CANWIRE_CAMPAIGN_REPORT_ROWCHECK_H

#include "base/text/jsonread.h"
#include "campaign/outcome.h"

/* Returns what is wrong with a row of this outcome, passed or failed, or NULL. */
const char *rowcheck_result(const jsonread_value *row, outcome o);

#endif
