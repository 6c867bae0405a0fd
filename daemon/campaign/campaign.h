/* SPDX-License-Identifier: MIT
 *
 * campaign.h - the file of a campaign: a scenario, what varies in it, and how it is sampled.
 */
#ifndef CANWIRE_CAMPAIGN_CAMPAIGN_H
#define CANWIRE_CAMPAIGN_CAMPAIGN_H

#include "campaign/ecus.h"
#include "campaign/space/number_text.h"
#include "campaign/space/splice.h"
#include "config/config.h"

#define CAMPAIGN_FACTORS_MAX 64u
#define CAMPAIGN_VALUES_MAX 1000000u /* in a list */
#define CAMPAIGN_ROWS_MAX (UINT64_C(1) << 62)
#define CAMPAIGN_LIMIT_MS 60000
#define CAMPAIGN_DETECTED_MAX 256u

typedef enum factor_kind {
    FACTOR_LIST = 0, /* texts */
    FACTOR_RANGE,    /* from + i * step */
    FACTOR_UNIFORM,  /* drawn */
    FACTOR_NORMAL
} factor_kind;

/* A value that varies, or a space of faults. */
typedef struct factor {
    const char *name;
    cfg_place place;
    factor_kind kind;
    const char *path; /* NULL: a space of faults, whose values are rules */
    bool is_seed;
    uint64_t count;      /* of values; of draws in a full product */
    uint64_t pruned;     /* values that no node can sample, which are left out */
    const char **texts;  /* LIST: the values as JSON */
    const char **rules;  /* of a space: the rules of each value, as lines of JSON */
    const char *rule_names[2]; /* of a space, or of the rule that the path is in; NULL: none */
    number_text from;    /* RANGE, UNIFORM; NORMAL: the mean */
    number_text to;      /* UNIFORM; NORMAL: the deviation */
    number_text step;
    splice_place edit;
} factor;

typedef enum campaign_sample {
    SAMPLE_FULL = 0,
    SAMPLE_PAIRWISE,
    SAMPLE_RANDOM,
    SAMPLE_LOW_DISCREPANCY
} campaign_sample;

typedef struct campaign {
    const char *file;
    const char *scenario_name; /* stands for its text in messages */
    const char *text;          /* of the scenario */
    size_t size;
    const char *until; /* NULL: to the end of the traffic */
    cfg_time until_time;
    uint64_t seed;          /* of the sample */
    uint64_t scenario_seed; /* in its file; 0 for a rig, whose buses have their own */
    int64_t limit_ms; /* of real time for one scenario */
    ecu_plan ecus;
    const char **detected; /* expectations that tell of a detection, see canwire-report(7) */
    size_t detected_count;
    uint64_t ftti_ns; /* the limit of detection latencies; 0: none */
    campaign_sample sample;
    uint64_t sample_count;
    size_t factor_count;
    factor factors[CAMPAIGN_FACTORS_MAX];
    uint64_t rows;   /* of the campaign */
    uint64_t pruned; /* rows of the full product that pruning has left out; saturates */
    uint32_t *pairs; /* SAMPLE_PAIRWISE: the values of each row, factor by factor */
} campaign;

/* Reads the file and its scenario. Returns NULL after writing one line per error to `errors`. */
campaign *campaign_load(const char *file, FILE *errors);

/* Frees it; NULL is allowed. */
void campaign_free(campaign *c);

#endif
