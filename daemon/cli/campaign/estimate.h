/* SPDX-License-Identifier: MIT
 *
 * estimate.h - how long the rows of a campaign will take.
 */
#ifndef CANWIRE_CLI_CAMPAIGN_ESTIMATE_H
#define CANWIRE_CLI_CAMPAIGN_ESTIMATE_H

#include "campaign/campaign.h"

/* Runs some rows from all parts of the campaign, in a process that is ended when one takes long.
 * Prints on standard output how long all rows will take in that many processes, or why that is not
 * known. Returns false after a message when no process can run them. */
bool estimate_print(const campaign *c, unsigned jobs);

#endif
