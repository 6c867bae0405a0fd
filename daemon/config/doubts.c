/* SPDX-License-Identifier: MIT
 *
 * doubts.c - what a valid configuration can be seen to miss before it runs.
 */
#include "config/doubts.h"

#include <stdlib.h>

#define WORK_MAX 1000000u /* entries that are looked at for one node */

uint64_t doubts_fed(const rig *config, size_t bus)
{
    uint64_t fed = 0;
    for (size_t i = 0; config && i < config->gateway_count; i++)
        for (unsigned end = 0; end < 2; end++)
            if (config->gateways[i].ends[end].bus == bus)
                fed |= UINT64_C(1) << config->gateways[i].ends[end].node;
    return fed;
}

/* ---- Frames ---------------------------------------------------------------------------------- */

/* Returns true when a rule makes frames that are not known before. */
static bool makes_any(const cw_rule *r)
{
    return r->action == CW_ACTION_LOAD || r->action == CW_ACTION_RAW;
}

static bool sends(const cw_rule *r)
{
    return r->action == CW_ACTION_SEND || r->action == CW_ACTION_BABBLE ||
           r->action == CW_ACTION_REPLY || r->action == CW_ACTION_RAW_FRAME;
}

static bool has_program(const cfg_node *node)
{
    return node->port || node->guest > 0;
}

/* Returns true when a node may send frames that the configuration does not name, but for those of a
 * program at its port. */
static bool is_open(const cfg *config, size_t i)
{
    const cfg_node *node = &config->nodes[i];
    bool open = false;
    for (size_t t = 0; t < node->traffic_count; t++)
        open = open || node->traffic[t].kind == CFG_TRAFFIC_REPLAY;
    for (unsigned m = 0; m < node->controller.mailbox_count; m++)
        open = open || node->controller.mailboxes[m].use == CW_MAILBOX_REPLY;
    for (size_t k = 0; k < config->rule_count; k++)
        open = open || (makes_any(&config->rules[k]) && config->rules[k].node == i);
    return open;
}

static bool matches(const cw_rule *rule, const cw_frame *frame)
{
    return cw_frame_matches(frame, rule->filters, rule->filter_count);
}

/* Returns true when a node sends a frame that a rule waits for. Its data are left out: counters,
 * checksums and rules change them. */
static bool sends_match(const cfg *config, size_t i, const cw_rule *rule)
{
    const cfg_node *node = &config->nodes[i];
    for (size_t t = 0; t < node->traffic_count; t++)
        if (matches(rule, &node->traffic[t].frame))
            return true;
    for (unsigned k = 0; k < node->schedule.trigger_count; k++)
        if (matches(rule, &node->schedule.triggers[k].frame))
            return true;
    for (size_t k = 0; k < config->rule_count; k++)
        if (sends(&config->rules[k]) && config->rules[k].node == i &&
            matches(rule, &config->rules[k].frame))
            return true;
    return false;
}

/* Returns true when rules may turn one frame into another. */
static bool identifiers_change(const cfg *config)
{
    bool change = false;
    for (size_t i = 0; i < config->rule_count; i++)
        change = change ||
                 (config->rules[i].action == CW_ACTION_CHANGE && config->rules[i].change.set_id);
    return change;
}

/* Finds who may send a frame that a rule waits for. */
static void find_senders(const cfg *config, const cw_rule *rule, uint64_t fed, bool *any,
                         bool *programs)
{
    const uint64_t from = rule->from ? rule->from : UINT64_MAX;
    *any = rule->trigger != CW_TRIGGER_FRAME || identifiers_change(config);
    *programs = false;
    for (size_t i = 0; i < config->node_count; i++) {
        if (!(from >> i & 1u))
            continue;
        *any = *any || (fed >> i & 1u) || is_open(config, i) || sends_match(config, i, rule);
        *programs = *programs || has_program(&config->nodes[i]);
    }
}

bool doubts_no_frame(const cfg *config, const cw_rule *rule, uint64_t fed)
{
    bool any;
    bool programs;
    find_senders(config, rule, fed, &any, &programs);
    return !any && !programs;
}

bool doubts_only_ports(const cfg *config, const cw_rule *rule, uint64_t fed)
{
    bool any;
    bool programs;
    find_senders(config, rule, fed, &any, &programs);
    return !any && programs;
}

/* ---- Armings --------------------------------------------------------------------------------- */

/* Goes back to the rule that arms all others of a chain. Returns NULL for a circle. */
static const cw_rule *find_first(const cfg *config, const cw_rule *rule, bool *by_hand)
{
    *by_hand = rule->manual;
    for (size_t steps = 0; steps < config->rule_count; steps++) {
        if (!rule->has_after || rule->after >= config->rule_count)
            return rule;
        rule = &config->rules[rule->after];
        *by_hand = *by_hand || rule->manual;
    }
    return NULL;
}

bool doubts_never_armed(const cfg *config, const cw_rule *rule)
{
    bool by_hand;
    return !find_first(config, rule, &by_hand) && !by_hand;
}

bool doubts_by_hand(const cfg *config, const cw_rule *rule)
{
    bool by_hand;
    (void)find_first(config, rule, &by_hand);
    return by_hand;
}

/* ---- Queues ---------------------------------------------------------------------------------- */

static bool has_known_times(const cfg_traffic *t)
{
    return t->kind == CFG_TRAFFIC_SEND && t->jitter.ns == 0 && t->jitter.bits == 0;
}

/* Returns the tick of release `done` of an entry, CW_NEVER behind the last one. */
static uint64_t release_tick(const cfg *config, const cfg_traffic *t, uint64_t done)
{
    if (!has_known_times(t) || done >= t->count)
        return CW_NEVER;
    return text_time_ticks_sum(t->offset, done, t->every, config->rate);
}

/* Takes all releases of the first tick that has any. Returns how many these are; 0: there are no
 * more. */
static unsigned doubts_take_first(const cfg *config, const cfg_node *node, uint64_t *done,
                                  uint64_t *tick)
{
    unsigned count = 0;
    *tick = CW_NEVER;
    for (size_t t = 0; t < node->traffic_count; t++) {
        const uint64_t next = release_tick(config, &node->traffic[t], done[t]);
        *tick = next < *tick ? next : *tick;
    }
    for (size_t t = 0; *tick != CW_NEVER && t < node->traffic_count; t++) {
        if (release_tick(config, &node->traffic[t], done[t]) != *tick)
            continue;
        done[t]++;
        count++;
    }
    return count;
}

unsigned doubts_at_once(const cfg *config, size_t i, uint64_t *tick)
{
    const cfg_node *node = &config->nodes[i];
    uint64_t *done = calloc(node->traffic_count + 1, sizeof *done);
    unsigned most = 0;
    unsigned count = 1;
    *tick = 0;
    for (size_t work = 0; done && count > 0 && work < WORK_MAX; work += node->traffic_count + 1) {
        uint64_t at;
        count = doubts_take_first(config, node, done, &at);
        if (count > most)
            *tick = at;
        most = count > most ? count : most;
    }
    free(done);
    return most;
}

/* ---- Acknowledgement ------------------------------------------------------------------------- */

/* Returns true for a node that begins transmissions by itself. Its replies need frames of others
 * first. */
static bool sends_frames(const cfg *config, size_t i)
{
    const cfg_node *node = &config->nodes[i];
    bool any = node->schedule.trigger_count > 0;
    for (size_t t = 0; t < node->traffic_count; t++)
        any = any || node->traffic[t].kind != CFG_TRAFFIC_REPLY;
    for (size_t k = 0; k < config->rule_count; k++)
        any = any || (sends(&config->rules[k]) && config->rules[k].node == i);
    return any;
}

/* A frame that nobody acknowledges is repeated, and later ones wait behind it. */
static bool sends_fd(const cfg_node *node)
{
    bool any = false;
    for (size_t t = 0; t < node->traffic_count; t++)
        any = any || (node->traffic[t].kind == CFG_TRAFFIC_SEND &&
                      (node->traffic[t].frame.flags & CW_FRAME_FD));
    return any;
}

/* Rules may change the modes of nodes. */
static bool modes_change(const cfg *config)
{
    bool change = false;
    for (size_t i = 0; i < config->rule_count; i++)
        change = change || config->rules[i].action == CW_ACTION_SET;
    return change;
}

bool doubts_no_acknowledgement(const cfg *config, size_t i)
{
    const unsigned alone = CW_MODE_PRESUME_ACK | CW_MODE_LOOPBACK | CW_MODE_LISTEN_ONLY;
    if ((config->nodes[i].modes & alone) || !sends_frames(config, i) || modes_change(config))
        return false;
    const bool fd = sends_fd(&config->nodes[i]);
    for (size_t k = 0; k < config->node_count; k++)
        if (k != i && (!fd || cfg_knows_fd(config, &config->nodes[k])) &&
            (!(config->nodes[k].modes & CW_MODE_LISTEN_ONLY) || config->nodes[k].port))
            return false;
    return true;
}
