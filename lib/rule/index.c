/* SPDX-License-Identifier: MIT
 *
 * index.c - rules by the identifier of the frames that they wait for.
 */
#include "rule/private.h"

#include "rule/list.h"

#include <string.h>

/* ---- Frames and filters ---------------------------------------------------------------------- */

static uint32_t can_id(const cw_frame *frame)
{
    uint32_t id = frame->id;
    if (frame->flags & CW_FRAME_EXTENDED)
        id |= CW_FILTER_EXTENDED;
    if (frame->flags & CW_FRAME_REMOTE)
        id |= CW_FILTER_REMOTE;
    return id;
}

static bool id_matches(uint32_t id, const cw_filter *filters, unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        bool same = (id & filters[i].mask) == (filters[i].value & filters[i].mask);
        if (same != filters[i].inverted)
            return true;
    }
    return count == 0;
}

bool cw_frame_matches(const cw_frame *frame, const cw_filter *filters, unsigned count)
{
    return id_matches(can_id(frame), filters, count);
}

static bool data_matches(const cw_rule *rule, const cw_frame *frame)
{
    if (rule->data_length > cw_frame_length(frame))
        return false;
    for (unsigned i = 0; i < rule->data_length; i++)
        if ((frame->data[i] ^ rule->data_value[i]) & rule->data_mask[i])
            return false;
    return true;
}

/* ---- Index: frame rules by their identifier -------------------------------------------------- */

#define EXACT_MASK (CW_FILTER_EXTENDED | 0x7FFu)
#define EXACT_MASK_EXTENDED (CW_FILTER_EXTENDED | 0x1FFFFFFFu)

/* Whether a rule waits for one identifier only. */
static bool has_exact_id(const cw_rule *rule, uint32_t *id)
{
    if (rule->filter_count != 1 || rule->filters[0].inverted)
        return false;
    const cw_filter *f = &rule->filters[0];
    uint32_t needed = f->value & CW_FILTER_EXTENDED ? EXACT_MASK_EXTENDED : EXACT_MASK;
    *id = f->value & needed;
    return (f->mask & needed) == needed;
}

static unsigned id_hash(uint32_t id)
{
    return id * UINT32_C(2654435761) >> 20;
}

static bool may_be_exact(const cw_fault_set *set, uint32_t id)
{
    unsigned hash = id_hash(id);
    return set->id_filter[hash / 64] >> (hash % 64) & 1u;
}

bool cw_fault_may_be_exact(const cw_fault_set *set, const cw_frame *frame)
{
    return may_be_exact(set, can_id(frame) & ~CW_FILTER_REMOTE);
}

static void filter_ids(cw_fault_set *set)
{
    memset(set->id_filter, 0, sizeof set->id_filter);
    for (unsigned i = 0; i < set->exact_count; i++) {
        unsigned hash = id_hash(set->exact[i].id);
        set->id_filter[hash / 64] |= UINT64_C(1) << (hash % 64);
    }
}

static unsigned find_exact(const cw_fault_set *set, uint32_t id, unsigned rule)
{
    unsigned low = 0;
    unsigned high = set->exact_count;
    while (low < high) {
        unsigned middle = (low + high) / 2;
        const cw_fault_key *k = &set->exact[middle];
        if (k->id < id || (k->id == id && k->rule < rule))
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

void cw_fault_index_add(cw_fault_set *set, unsigned rule)
{
    uint32_t id;
    const cw_rule *r = &set->faults[rule].rule;
    if (r->trigger != CW_TRIGGER_FRAME)
        return;
    if (!has_exact_id(r, &id)) {
        cw_list_add(set->wild, &set->wild_count, rule);
        return;
    }
    unsigned place = find_exact(set, id, rule);
    memmove(&set->exact[place + 1], &set->exact[place],
            (set->exact_count - place) * sizeof set->exact[0]);
    set->exact[place] = (cw_fault_key){.id = id, .rule = (uint16_t)rule};
    set->exact_count++;
    filter_ids(set);
}

void cw_fault_index_remove(cw_fault_set *set, unsigned rule)
{
    cw_list_remove(set->wild, &set->wild_count, rule);
    for (unsigned i = 0; i < set->exact_count; i++) {
        if (set->exact[i].rule != rule)
            continue;
        set->exact_count--;
        memmove(&set->exact[i], &set->exact[i + 1],
                (set->exact_count - i) * sizeof set->exact[0]);
        filter_ids(set);
        return;
    }
}

void cw_candidates_begin(cw_candidates *c, const cw_bus *bus, const cw_frame *frame)
{
    const cw_fault_set *set = &bus->faults;
    *c = (cw_candidates){.frame = frame, .id = can_id(frame)};
    uint32_t id = c->id & ~CW_FILTER_REMOTE;
    if (!may_be_exact(set, id))
        return;
    c->exact = find_exact(set, id, 0);
    c->exact_end = c->exact;
    while (c->exact_end < set->exact_count && set->exact[c->exact_end].id == id)
        c->exact_end++;
}

/* The next rule of either list, in order. */
static bool next_in_lists(cw_candidates *c, unsigned *rule, const cw_fault_set *set)
{
    bool exact = c->exact < c->exact_end;
    bool wild = c->wild < set->wild_count;
    if (exact && wild)
        exact = set->exact[c->exact].rule < set->wild[c->wild];
    if (exact)
        *rule = set->exact[c->exact++].rule;
    else if (wild)
        *rule = set->wild[c->wild++];
    return exact || wild;
}

bool cw_candidates_next(cw_candidates *c, unsigned *rule, const cw_bus *bus)
{
    const cw_fault_set *set = &bus->faults;
    while (next_in_lists(c, rule, set)) {
        const cw_rule *r = &set->faults[*rule].rule;
        if (id_matches(c->id, r->filters, r->filter_count) &&
            (r->data_length == 0 || data_matches(r, c->frame)))
            return true;
    }
    return false;
}
