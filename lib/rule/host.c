/* SPDX-License-Identifier: MIT
 *
 * host.c - the actions of fault rules on frames between a host and its controller.
 *
 * A frame that a rule holds back counts as pending. When there is no room to hold it, it goes on.
 * The hit counts all the same, without further effect.
 */
#include "rule/private.h"

#include <string.h>

/* ---- Frames held back ------------------------------------------------------------------------ */

bool cw_rules_hold(cw_rule_set *set, const cw_held_frame *frame)
{
    if (set->held_count == CW_HELD_FRAMES)
        return false;
    cw_held_copy(set, cw_held_at(set, set->held_count++), frame);
    cw_rules_set_due(set, frame->due);
    return true;
}

/* Queues a frame that counts as the host's, not as traffic of a rule. */
static void queue(const cw_rule_set *set, unsigned node, const cw_frame *frame, uint64_t tick)
{
    set->bus.effects->queue(set->bus.self, node, frame, tick, 0);
}

/* Lets a frame that was held back go on to its queue or host. No rule sees it again. */
static void deliver_held(cw_rule_set *set, const cw_held_frame *h, uint64_t tick)
{
    if (h->side == CW_SIDE_TX)
        queue(set, h->node, &h->frame, tick);
    else
        set->bus.effects->hand_out(set->bus.self, h->node, &h->frame, &h->origin);
}

/* Releases the frames that are due by now, in the order in which they were held back. */
static void release(cw_rule_set *set, uint64_t tick)
{
    unsigned kept = 0;
    for (unsigned i = 0; i < set->held_count; i++) {
        cw_held_frame h;
        cw_held_copy(set, &h, cw_held_at(set, i));
        if (h.due <= cw_rules_now(set))
            deliver_held(set, &h, tick);
        else
            cw_held_copy(set, cw_held_at(set, kept++), &h);
    }
    set->held_count = kept;
}

bool cw_rules_take_held(cw_rule_set *set, unsigned node, cw_held_frame *frame)
{
    unsigned place = 0;
    while (place < set->held_count && cw_held_at(set, place)->node != node)
        place++;
    if (place == set->held_count)
        return false;
    cw_held_copy(set, frame, cw_held_at(set, place));
    set->held_count--;
    memmove(cw_held_at(set, place), cw_held_at(set, place + 1),
            (set->held_count - place) * set->held_size);
    return true;
}

void cw_rules_release_held(cw_rule_set *set)
{
    release(set, cw_rules_now(set));
}

uint64_t cw_rules_next_held(const cw_rule_set *set)
{
    uint64_t next = CW_NEVER;
    for (unsigned i = 0; i < set->held_count; i++)
        next = cw_least(next, cw_held_at(set, i)->due);
    return next;
}

void cw_rules_count_held(const cw_rule_set *set, unsigned node, uint32_t *tx, uint32_t *rx)
{
    *tx = 0;
    *rx = 0;
    for (unsigned i = 0; i < set->held_count; i++) {
        const cw_held_frame *h = cw_held_at(set, i);
        if (h->node == node)
            (*(h->side == CW_SIDE_TX ? tx : rx))++;
    }
}

void cw_rule_let_go(cw_rule_set *set, unsigned rule)
{
    for (unsigned i = 0; i < set->held_count; i++) {
        if (cw_held_at(set, i)->rule != rule)
            continue;
        cw_held_at(set, i)->due = cw_rules_now(set);
        cw_rules_set_due(set, cw_rules_now(set));
    }
}

void cw_rules_passed(cw_rule_set *set, unsigned node, cw_side side, uint64_t tick)
{
    bool due = false;
    for (unsigned i = 0; i < set->held_count; i++) {
        cw_held_frame *h = cw_held_at(set, i);
        if (h->node != node || h->side != side || h->behind == 0 || --h->behind > 0)
            continue;
        h->due = cw_rules_now(set);
        due = true;
    }
    if (due)
        release(set, tick);
}

/* ---- Actions --------------------------------------------------------------------------------- */

/* CHANGE: the identifier and the DLC become the given ones; bits of the data are set, masked,
 * inverted. */
bool cw_change_frame(cw_rule_set *set, const cw_rule *rule, const cw_passing *p)
{
    (void)set;
    const cw_change *c = &rule->change;
    cw_frame *frame = p->frame;
    if (c->set_id) {
        frame->id = c->id;
        frame->flags = (uint8_t)((frame->flags & ~CW_FRAME_EXTENDED) | c->id_flags);
    }
    if (c->set_dlc)
        frame->dlc = c->dlc;
    for (unsigned i = 0; i < cw_frame_length(frame); i++) {
        unsigned byte = (frame->data[i] & ~(unsigned)c->set_mask[i]) | (c->set[i] & c->set_mask[i]);
        byte = (byte & c->and_mask[i]) | c->or_mask[i];
        frame->data[i] = (uint8_t)(byte ^ c->xor_mask[i]);
    }
    return true;
}

/* DUPLICATE: the copies go before the frame itself, with its tick. */
bool cw_copy_frame(cw_rule_set *set, const cw_rule *rule, const cw_passing *p)
{
    const cw_rule_effects *effects = set->bus.effects;
    for (unsigned i = 0; i < rule->number; i++) {
        effects->count_made(set->bus.self, p->node, rule->side);
        if (rule->side == CW_SIDE_TX)
            queue(set, p->node, p->frame, p->tick);
        else
            effects->hand_out(set->bus.self, p->node, p->frame, p->origin);
    }
    return true;
}

/* DROP: the frame does not go on. */
bool cw_drop_frame(cw_rule_set *set, const cw_rule *rule, const cw_passing *p)
{
    set->bus.effects->drop(set->bus.self, p->node, rule->side, p->frame, p->tick);
    return false;
}

/* Returns true when there is no room to hold the frame back, so that it goes on. */
static bool hold_back(cw_rule_set *set, const cw_rule *rule, const cw_passing *p, uint64_t due,
                      uint32_t behind)
{
    cw_held_frame h = {.due = due,
                       .behind = behind,
                       .rule = (uint16_t)p->rule,
                       .node = (uint8_t)p->node,
                       .side = rule->side,
                       .origin = *p->origin};
    cw_frame_copy(&h.frame, p->frame);
    return !cw_rules_hold(set, &h);
}

/* DELAY: the frame goes on later; others overtake it. */
bool cw_delay_frame(cw_rule_set *set, const cw_rule *rule, const cw_passing *p)
{
    return hold_back(set, rule, p, cw_after(p->tick, rule->for_ticks), 0);
}

/* REORDER: the frame goes on behind the next ones of its node and side. */
bool cw_let_overtake(cw_rule_set *set, const cw_rule *rule, const cw_passing *p)
{
    return rule->number == 0 ||
           hold_back(set, rule, p, CW_NEVER, rule->number + 1); /* the frame itself passes first */
}

/* Returns whether a matching frame is a hit. A frame that several nodes receive is one match. */
static bool is_hit(cw_rule_set *set, unsigned rule, cw_side side, uint64_t tick)
{
    cw_rule_state *s = &set->rules[rule];
    bool decided = side == CW_SIDE_RX && s->host.rx_tick == tick;
    if (!decided) {
        s->host.rx_tick = tick;
        s->host.rx_hit = cw_rule_match(set, rule, tick, tick);
    }
    if (s->host.rx_hit && !decided)
        cw_rule_report_hit(set, rule, tick);
    return s->host.rx_hit;
}

/* made_by: the protection of the frame for rules on what it has written, or NULL for all others. */
static bool run_rules(cw_rule_set *set, unsigned node, cw_frame *frame, cw_side side, uint64_t tick,
                      const cw_frame_origin *origin, cw_protected *made_by)
{
    cw_frame original;
    uint64_t self = cw_node_bit(node);
    uint64_t from = side == CW_SIDE_TX ? self : origin->from;
    cw_candidates c;
    unsigned rule;
    cw_frame_copy(&original, frame);
    cw_candidates_begin(&c, set, &original);
    while (cw_candidates_next(&c, &rule, set)) {
        const cw_rule_state *s = cw_rule_at(set, rule);
        const cw_rule *r = &s->rule;
        if (s->does->kind != CW_KIND_HOST || r->side != side || !cw_rule_names(r->from, from) ||
            !cw_rule_names(r->at, self) || !cw_rule_is_for(s, made_by) ||
            !is_hit(set, rule, side, tick))
            continue;
        const cw_passing p = {.frame = frame, .rule = rule, .node = node, .tick = tick,
                              .origin = origin, .made_by = made_by};
        if (!s->does->host(set, r, &p))
            return false;
    }
    return true;
}

/* ---- Replies --------------------------------------------------------------------------------- */

/* Sends the frame of a reply, after its time. */
static void reply(cw_rule_set *set, unsigned rule, unsigned node)
{
    const cw_rule *r = &set->rules[rule].rule;
    const cw_held_frame h = {.due = cw_after(cw_rules_now(set), r->for_ticks),
                             .rule = (uint16_t)rule,
                             .node = (uint8_t)node,
                             .side = CW_SIDE_TX,
                             .frame = r->frame};
    cw_rule_report_hit(set, rule, cw_rules_now(set));
    set->bus.effects->count_made(set->bus.self, node, CW_SIDE_TX);
    if (!cw_rules_hold(set, &h))
        queue(set, node, &h.frame, cw_rules_now(set));
}

/* Lets replies to a received frame act. `from` has its transmitters. */
static void host_answer(cw_rule_set *set, unsigned node, const cw_frame *frame, uint64_t from)
{
    cw_candidates c;
    unsigned rule;
    if (set->reply_rules == 0)
        return;
    cw_candidates_begin(&c, set, frame);
    while (cw_candidates_next(&c, &rule, set)) {
        const cw_rule *r = &set->rules[rule].rule;
        if (r->action == CW_ACTION_REPLY && r->node == node &&
            cw_rule_names(r->from, from) &&
            cw_rule_match(set, rule, cw_rules_now(set), cw_rules_now(set)))
            reply(set, rule, node);
    }
}

/* ---- Frames that come by --------------------------------------------------------------------- */

bool cw_rules_hand_in(cw_rule_set *set, unsigned node, cw_frame *frame, uint64_t tick)
{
    static const cw_frame_origin none = {.from = 0};
    cw_protected *made_by = NULL;
    if (set->hand_in_rules == 0)
        return true;
    if (set->protection_count > 0)
        made_by = cw_rules_protect(set, node, frame);
    if (made_by && set->making_rules > 0)
        (void)run_rules(set, node, frame, CW_SIDE_TX, tick, &none, made_by);
    return set->host_rules == 0 || run_rules(set, node, frame, CW_SIDE_TX, tick, &none, NULL);
}

bool cw_rules_hand_out(cw_rule_set *set, unsigned node, cw_frame *frame,
                       const cw_frame_origin *origin)
{
    host_answer(set, node, frame, origin->from);
    return set->host_rules == 0 ||
           run_rules(set, node, frame, CW_SIDE_RX, cw_rules_now(set), origin, NULL);
}
