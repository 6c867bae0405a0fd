/* SPDX-License-Identifier: MIT
 *
 * rowcheck.h - whether the keys of a row with a result have values that canwire writes.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_ROWCHECK_H
#define CANWIRE_CAMPAIGN_REPORT_ROWCHECK_H

#include "campaign/outcome.h"

#include <jansson.h>

/* Returns what is wrong with a row of this outcome, passed or failed, or NULL. */
const char *rowcheck_result(const json_t *row, outcome o);

#endif
