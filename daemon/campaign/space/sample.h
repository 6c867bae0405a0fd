/* SPDX-License-Identifier: MIT
 *
 * sample.h - the values of the factors in a row of a campaign, by the number of the row alone.
 */
#ifndef CANWIRE_CAMPAIGN_SAMPLE_H
#define CANWIRE_CAMPAIGN_SAMPLE_H

#include "campaign/campaign.h"
#include "base/text/buffer.h"

#include <stdint.h>

/* The choice of one factor. */
typedef struct choice {
    uint64_t index; /* of a value */
    uint64_t drawn; /* UNIFORM, NORMAL: of 2^64 */
} choice;

/* Finds out how many rows there are. Returns NULL, or what is wrong. */
const char *sample_prepare(campaign *c);

/* Makes the choices of a row below c->rows. */
void sample_choose(choice out[CAMPAIGN_FACTORS_MAX], const campaign *c, uint64_t row);

/* Returns the value of a factor as JSON: the text of the factor, or `out`. */
const char *sample_text(char out[NUMBER_TEXT_MAX], const factor *f, const choice *chosen);

/* Appends it. */
void sample_value(buffer *out, const factor *f, const choice *chosen);

#endif
