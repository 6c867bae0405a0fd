/* SPDX-License-Identifier: MIT
 *
 * pairwise.h - rows that have each pair of values of each two factors at least once.
 */
#ifndef CANWIRE_CAMPAIGN_PAIRWISE_H
#define CANWIRE_CAMPAIGN_PAIRWISE_H

#include "campaign/campaign.h"

#define PAIRWISE_PAIRS_MAX 4000000u

/* Finds the rows of a campaign. Returns NULL, or what is wrong. */
const char *pairwise_prepare(campaign *c);

#endif
