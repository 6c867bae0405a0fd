/* SPDX-License-Identifier: MIT
 *
 * index.c - finds rules by the identifier of the frames that they wait for.
 */
#include "rule/private.h"

#include "rule/list.h"

#include <limits.h>
#include <string.h>

/* ---- Frames and filters ---------------------------------------------------------------------- */

/* Returns true when one of the filters takes the identifier, or there is none. */
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
    return id_matches(cw_frame_can_id(frame), filters, count);
}

/* Returns true when the data field of the frame has the rate that the rule asks for. */
static bool rate_matches(const cw_rule *rule, const cw_frame *frame)
{
    const bool fast = (frame->flags & CW_FRAME_FD) && (frame->flags & CW_FRAME_BRS);
    return rule->rate == CW_RATE_ANY || (rule->rate == CW_RATE_DATA) == fast;
}

/* Compares what the filters of identifiers leave open: the rate, and the first data bytes. */
static bool content_matches(const cw_rule *rule, const cw_frame *frame)
{
    if (!rate_matches(rule, frame) || rule->data_length > cw_frame_length(frame))
        return false;
    for (unsigned i = 0; i < rule->data_length; i++)
        if ((frame->data[i] ^ rule->data_value[i]) & rule->data_mask[i])
            return false;
    return true;
}

/* ---- Classes of identifiers ------------------------------------------------------------------ */

/* Filters that look at the same bits of an identifier are of one class. The first two classes are
 * for single identifiers; the others are given out as they are needed. */
#define FIRST_FREE_CLASS 2u

/* Returns the class of a mask, a new one if need be; CW_ID_CLASSES when there is no room for one
 * more. */
static unsigned class_of(cw_rule_set *set, uint32_t mask)
{
    unsigned room = CW_ID_CLASSES;
    set->classes[0].mask = CW_FILTER_BASE_MASK;
    set->classes[1].mask = CW_FILTER_EXTENDED_MASK;
    for (unsigned i = 0; i < CW_ID_CLASSES; i++) {
        bool given = i < FIRST_FREE_CLASS || set->classes[i].count > 0;
        if (given && set->classes[i].mask == mask)
            return i;
        if (!given && room == CW_ID_CLASSES)
            room = i;
    }
    if (room < CW_ID_CLASSES)
        set->classes[room].mask = mask;
    return room;
}

static unsigned id_hash(uint32_t id)
{
    return id * UINT32_C(2654435761) >> (32 - CW_ID_HASH_BITS);
}

/* Returns whether a rule may wait for an identifier by a filter of a class. For most identifiers
 * one look at a table shows that none does. */
static inline bool may_wait(const cw_rule_set *set, unsigned class, uint32_t id)
{
    const unsigned classes = set->id_classes[id_hash(id & set->classes[class].mask)];
    return classes >> class & 1u;
}

bool cw_rules_may_wait(const cw_rule_set *set, const cw_frame *frame)
{
    const uint32_t id = cw_frame_can_id(frame);
    for (unsigned i = 0; i < set->class_count; i++)
        if (may_wait(set, i, id))
            return true;
    return false;
}

/* ---- Keys ------------------------------------------------------------------------------------ */

/* Returns the place where a key of a class stands, or would stand. */
static unsigned index_find_key(const cw_rule_set *set, unsigned class, uint32_t id, unsigned rule)
{
    unsigned low = set->classes[class].first;
    unsigned high = low + set->classes[class].count;
    while (low < high) {
        unsigned middle = (low + high) / 2;
        const cw_rule_key *k = &set->keys[middle];
        if (k->id < id || (k->id == id && k->rule < rule))
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Notes that frames with the hash of this identifier may have a rule in that class. */
static void note_id(cw_rule_set *set, const cw_rule_key *k)
{
    uint8_t *classes = &set->id_classes[id_hash(k->id)];
    *classes = (uint8_t)(*classes | 1u << k->class);
}

/* Adds a key in its place. The classes behind its own start one later. */
static void add_key(cw_rule_set *set, cw_rule_key key)
{
    unsigned place = index_find_key(set, key.class, key.id, key.rule);
    memmove(&set->keys[place + 1], &set->keys[place],
            (set->key_count - place) * sizeof set->keys[0]);
    set->keys[place] = key;
    set->key_count++;
    set->classes[key.class].count++;
    for (unsigned i = key.class + 1u; i < CW_ID_CLASSES; i++)
        set->classes[i].first++;
    if (set->class_count <= key.class)
        set->class_count = key.class + 1u;
    note_id(set, &key);
}

/* Counts the keys anew after some have been removed. */
static void count_keys(cw_rule_set *set)
{
    memset(set->id_classes, 0, sizeof set->id_classes);
    for (unsigned i = 0; i < CW_ID_CLASSES; i++)
        set->classes[i].count = 0;
    for (unsigned i = 0; i < set->key_count; i++) {
        set->classes[set->keys[i].class].count++;
        note_id(set, &set->keys[i]);
    }
    set->class_count = 0;
    for (unsigned i = 0, first = 0; i < CW_ID_CLASSES; i++) {
        set->classes[i].first = (uint16_t)first;
        first += set->classes[i].count;
        if (set->classes[i].count > 0)
            set->class_count = i + 1;
    }
}

/* Removes the keys of a rule. Hashes are found anew, since keys share them. */
static void remove_keys(cw_rule_set *set, unsigned rule)
{
    unsigned kept = 0;
    for (unsigned i = 0; i < set->key_count; i++)
        if (set->keys[i].rule != rule)
            set->keys[kept++] = set->keys[i];
    if (kept == set->key_count)
        return;
    set->key_count = kept;
    count_keys(set);
}

/* Adds the key of a filter. Returns false when the filter looks at no bit of the identifier, is
 * inverted, or there is no class for it. */
static bool add_filter(cw_rule_set *set, unsigned rule, const cw_filter *f)
{
    const uint32_t mask = f->mask & CW_FILTER_EXTENDED_MASK;
    if (mask == 0 || f->inverted)
        return false;
    const unsigned class = class_of(set, mask);
    if (class == CW_ID_CLASSES)
        return false;
    add_key(set, (cw_rule_key){.id = f->value & mask, .rule = (uint16_t)rule,
                                .class = (uint8_t)class});
    return true;
}

/* Adds a key for each filter of a rule. Returns false when one can have no key; keys of earlier
 * filters stay. */
static bool add_keys(cw_rule_set *set, unsigned rule)
{
    const cw_rule *r = &set->rules[rule].rule;
    for (unsigned i = 0; i < r->filter_count; i++)
        if (!add_filter(set, rule, &r->filters[i]))
            return false;
    return r->filter_count > 0;
}

/* ---- The index ------------------------------------------------------------------------------- */

void cw_index_add(cw_rule_set *set, unsigned rule)
{
    if (set->rules[rule].rule.trigger != CW_TRIGGER_FRAME || add_keys(set, rule))
        return;
    remove_keys(set, rule);
    cw_list_add(set->wildcards, &set->wildcard_count, rule);
}

void cw_index_remove(cw_rule_set *set, unsigned rule)
{
    cw_list_remove(set->wildcards, &set->wildcard_count, rule);
    remove_keys(set, rule);
}

/* Adds the keys of a class with the frame's identifier, if there are any. */
static void add_run(cw_candidates *c, const cw_rule_set *set, unsigned class)
{
    const uint32_t id = c->id & set->classes[class].mask;
    const unsigned end = set->classes[class].first + set->classes[class].count;
    cw_key_run run = {.next = (uint16_t)index_find_key(set, class, id, 0)};
    run.end = run.next;
    while (run.end < end && set->keys[run.end].id == id)
        run.end++;
    if (run.next < run.end)
        c->runs[c->run_count++] = run;
}

void cw_candidates_begin(cw_candidates *c, const cw_rule_set *set, const cw_frame *frame)
{
    c->frame = frame;
    c->id = cw_frame_can_id(frame);
    c->run_count = 0;
    c->wildcard = 0;
    for (unsigned i = 0; i < set->class_count; i++)
        if (may_wait(set, i, c->id))
            add_run(c, set, i);
}

/* Finds the next rule of all runs and the list, in order. A rule with several filters may be in
 * several of them. */
static bool next_rule(cw_candidates *c, unsigned *rule, const cw_rule_set *set)
{
    const bool listed = c->wildcard < set->wildcard_count;
    unsigned next = listed ? set->wildcards[c->wildcard] : UINT_MAX;
    for (unsigned i = 0; i < c->run_count; i++) {
        const cw_key_run *run = &c->runs[i];
        if (run->next < run->end && set->keys[run->next].rule < next)
            next = set->keys[run->next].rule;
    }
    if (listed && set->wildcards[c->wildcard] == next)
        c->wildcard++;
    for (unsigned i = 0; i < c->run_count; i++) {
        cw_key_run *run = &c->runs[i];
        while (run->next < run->end && set->keys[run->next].rule == next)
            run->next++;
    }
    *rule = next;
    return next != UINT_MAX;
}

bool cw_candidates_next(cw_candidates *c, unsigned *rule, const cw_rule_set *set)
{
    while (next_rule(c, rule, set)) {
        const cw_rule *r = &set->rules[*rule].rule;
        if (id_matches(c->id, r->filters, r->filter_count) &&
            ((r->data_length == 0 && r->rate == CW_RATE_ANY) || content_matches(r, c->frame)))
            return true;
    }
    return false;
}
