/* SPDX-License-Identifier: MIT
 *
 * shard.h - the part of the rows that one of several runs does.
 */
#ifndef CANWIRE_CAMPAIGN_SHARD_H
#define CANWIRE_CAMPAIGN_SHARD_H

#include <stdbool.h>
#include <stdint.h>

/* Number k of n parts, from 1 on. */
typedef struct shard {
    uint64_t k;
    uint64_t n;
} shard;

/* Reads K/N. Returns false for another text. */
bool shard_parse(shard *out, const char *text);

#define SHARD_PROBLEM_MAX 160u

/* Takes it from the environment: that of a whole array of Slurm, an indexed job of Kubernetes, or a
 * parallel job of GitLab. Without one there is one part. Returns false with a message, without line
 * end: variables are missing or make no sense, or the array may be a part of another one. */
bool shard_find(shard *out, char problem[SHARD_PROBLEM_MAX]);

/* Returns the first of `rows` rows of a part; that of part n + 1 is `rows`. The rows of all parts
 * one after the other are all rows in their order. */
uint64_t shard_begin(const shard *s, uint64_t k, uint64_t rows);

#endif
