/* SPDX-License-Identifier: MIT
 *
 * top_model.h - what canwire top knows of a bus: numbers of its last status, and rates.
 */
#ifndef CANWIRE_CLI_TOP_TOP_MODEL_H
#define CANWIRE_CLI_TOP_TOP_MODEL_H

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>

#define TOP_NAME_MAX 64
#define TOP_NODES_MAX 64
#define TOP_RULES_MAX 1024

/* A counter, and its rate in thousandths a second of bus time. */
typedef struct top_counter {
    int64_t value;
    int64_t rate;
} top_counter;

typedef struct top_node {
    char name[TOP_NAME_MAX];
    char state[TOP_NAME_MAX];
    int64_t tec;
    int64_t rec;
    top_counter tx;
    top_counter rx;
    top_counter errors;
    int64_t delay_max_ns; /* 0: nothing sent */
} top_node;

typedef struct top_rule {
    char name[TOP_NAME_MAX];
    char action[TOP_NAME_MAX];
    char state[TOP_NAME_MAX];
    bool injected;
    top_counter hits;
} top_rule;

typedef struct top_model {
    bool known; /* there has been a status */
    char name[TOP_NAME_MAX];
    int64_t bitrate;
    int64_t pid;
    int64_t time_ns;
    int64_t load_permille; /* of the last second */
    int64_t lag_ns;
    top_counter frames;
    top_counter errors;
    top_counter faults;
    unsigned node_count;
    unsigned rule_count;
    top_node nodes[TOP_NODES_MAX];
    top_rule rules[TOP_RULES_MAX];
} top_model;

/* Takes the replies to `status` and `faults`. Rates are those since the replies before. A bus that
 * has begun anew has no rates yet. */
void top_model_take(top_model *m, const json_t *status, const json_t *faults);

#endif
