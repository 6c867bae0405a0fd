/* SPDX-License-Identifier: MIT
 *
 * scenario.c - scenarios as data, and the random numbers they are made of.
 */
#include "differential.h"

#include <stdlib.h>
#include <string.h>

/* ---- Random numbers -------------------------------------------------------------------------- */

void diff_random_init(diff_random *r, uint64_t seed)
{
    r->state = seed * UINT64_C(0xD1342543DE82EF95) + 1;
    (void)diff_draw(r);
    (void)diff_draw(r);
}

/* Draws from a linear congruential generator, with its high bits mixed into the low ones. */
uint64_t diff_draw(diff_random *r)
{
    r->state = r->state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    uint64_t z = (r->state ^ (r->state >> 29)) * UINT64_C(0xAEF17502108EF2D9);
    return z ^ (z >> 32);
}

uint64_t diff_below(diff_random *r, uint64_t limit)
{
    return limit ? diff_draw(r) % limit : 0;
}

uint64_t diff_between(diff_random *r, uint64_t least, uint64_t most)
{
    return least + diff_below(r, most - least + 1);
}

bool diff_chance(diff_random *r, unsigned permille)
{
    return diff_below(r, 1000) < permille;
}

uint64_t diff_magnitude(diff_random *r, uint64_t least, uint64_t most)
{
    unsigned octaves = 0;
    while (least << (octaves + 1) <= most)
        octaves++;
    uint64_t low = least << diff_below(r, octaves + 1);
    uint64_t high = 2 * low < most ? 2 * low : most;
    return diff_between(r, low, high);
}

/* ---- Scenarios ------------------------------------------------------------------------------- */

const char *diff_name(unsigned number)
{
    static char names[DIFF_NAMES][8];
    char *name = names[number % DIFF_NAMES];
    (void)snprintf(name, sizeof names[0], "r%u", number % DIFF_NAMES);
    return name;
}

const cw_bus_config *diff_fill_in(diff_plan *plan, cw_rule rules[DIFF_RULES_MAX])
{
    for (unsigned i = 0; i < plan->config.rule_count; i++) {
        rules[i] = plan->rules[i].rule;
        rules[i].name = diff_name(plan->rules[i].name);
    }
    plan->config.nodes = plan->nodes;
    plan->config.rules = rules;
    plan->config.protections = plan->protections;
    return &plan->config;
}

void *diff_allocate(void *old, size_t size)
{
    void *memory = realloc(old, size ? size : 1);
    if (!memory) {
        fputs("differential: out of memory\n", stderr);
        exit(2);
    }
    return memory;
}

void diff_scenario_copy(diff_scenario *to, const diff_scenario *from)
{
    *to = *from;
    to->op_room = from->op_count ? from->op_count : 1;
    to->ops = diff_allocate(NULL, to->op_room * sizeof to->ops[0]);
    memcpy(to->ops, from->ops, from->op_count * sizeof to->ops[0]);
}

void diff_scenario_free(diff_scenario *s)
{
    free(s->ops);
    s->ops = NULL;
    s->op_count = 0;
}

void diff_add_op(diff_scenario *s, const diff_op *op)
{
    if (s->op_count == s->op_room) {
        s->op_room = s->op_room ? 2 * s->op_room : 64;
        s->ops = diff_allocate(s->ops, s->op_room * sizeof s->ops[0]);
    }
    s->ops[s->op_count++] = *op;
}
