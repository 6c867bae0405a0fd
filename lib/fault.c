/* SPDX-License-Identifier: MIT
 *
 * fault.c - when fault rules act: indexing, binding, matches, hits, what is due.
 */
#include "bus/bus_private.h"

#include "mac/confinement.h"
#include "format/bits.h"

#include <string.h>

#define RULES_OF_A_PIECE 16u /* of work: that are looked at and have nothing to do */

static cw_fault *fault_at(cw_bus *bus, unsigned rule)
{
    return &bus->faults.faults[rule];
}

bool cw_fault_is_over(const cw_fault *f)
{
    return f->rule.count != 0 && f->hits >= f->rule.count;
}

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

/* Where a rule stands, or would stand, in a sorted list. */
static unsigned find_in_list(const uint16_t *list, unsigned count, unsigned rule)
{
    unsigned place = 0;
    while (place < count && list[place] < rule)
        place++;
    return place;
}

static void list_add(uint16_t *list, unsigned *count, unsigned rule)
{
    unsigned place = find_in_list(list, *count, rule);
    memmove(&list[place + 1], &list[place], (*count - place) * sizeof list[0]);
    list[place] = (uint16_t)rule;
    (*count)++;
}

static void list_remove(uint16_t *list, unsigned *count, unsigned rule)
{
    unsigned place = find_in_list(list, *count, rule);
    if (place == *count || list[place] != rule)
        return;
    (*count)--;
    memmove(&list[place], &list[place + 1], (*count - place) * sizeof list[0]);
}

static void index_add(cw_fault_set *set, unsigned rule)
{
    uint32_t id;
    const cw_rule *r = &set->faults[rule].rule;
    if (r->trigger != CW_TRIGGER_FRAME)
        return;
    if (!has_exact_id(r, &id)) {
        list_add(set->wild, &set->wild_count, rule);
        return;
    }
    unsigned place = find_exact(set, id, rule);
    memmove(&set->exact[place + 1], &set->exact[place],
            (set->exact_count - place) * sizeof set->exact[0]);
    set->exact[place] = (cw_fault_key){.id = id, .rule = (uint16_t)rule};
    set->exact_count++;
    filter_ids(set);
}

static void index_remove(cw_fault_set *set, unsigned rule)
{
    list_remove(set->wild, &set->wild_count, rule);
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

/* ---- Matches and hits ------------------------------------------------------------------------ */

static bool needs_arming(const cw_rule *rule)
{
    return rule->has_after || rule->manual;
}

static bool states_match(const cw_bus *bus, const cw_rule *rule)
{
    for (uint64_t rest = rule->state_nodes; rest; rest &= rest - 1) {
        unsigned state = 1u << cw_mac_state(&bus->nodes[cw_lowest_node(rest)].mac);
        if (!(rule->state_mask & state))
            return false;
    }
    return true;
}

static bool is_gated(const cw_bus *bus, const cw_fault *f, uint64_t start)
{
    const cw_rule *r = &f->rule;
    return start < r->time_begin || start >= r->time_end || cw_fault_is_over(f) ||
           (needs_arming(r) && f->armed == 0) || !states_match(bus, r);
}

void cw_fault_due(cw_bus *bus, uint64_t tick)
{
    bus->faults.next_due = cw_least(bus->faults.next_due, tick);
}

static bool add_arming(cw_bus *bus, unsigned rule, uint64_t tick)
{
    cw_fault *f = fault_at(bus, rule);
    if (f->armings == CW_ARMINGS_MAX)
        return false;
    unsigned place = f->armings++;
    for (; place > 0 && f->arm_at[place - 1] > tick; place--)
        f->arm_at[place] = f->arm_at[place - 1];
    f->arm_at[place] = tick;
    cw_fault_due(bus, tick);
    return true;
}

static void remove_first_arming(cw_fault *f)
{
    f->armings--;
    memmove(&f->arm_at[0], &f->arm_at[1], f->armings * sizeof f->arm_at[0]);
}

/* When the next arming takes place. Rules without delay can make a ring: it goes round once in a
 * bit. */
static uint64_t next_arming(const cw_fault *f)
{
    if (f->armings == 0)
        return CW_NEVER;
    bool again = f->armed_at != CW_NEVER && f->arm_at[0] <= f->armed_at;
    return again ? f->armed_at + 1 : f->arm_at[0];
}

/* Rules that come after this one are armed, at once or later. */
static void arm_followers(cw_bus *bus, unsigned rule, uint64_t told)
{
    if (bus->faults.after_rules == 0)
        return;
    bus->work += 1 + bus->faults.count / RULES_OF_A_PIECE;
    for (unsigned i = 0; i < bus->faults.count; i++) {
        const cw_fault *f = fault_at(bus, i);
        if (f->used && f->rule.has_after && f->rule.after == rule)
            (void)add_arming(bus, i, cw_after(told, f->rule.after_delay));
    }
}

void cw_fault_count_hit(cw_bus *bus, unsigned rule, uint64_t told)
{
    cw_fault *f = fault_at(bus, rule);
    f->hits++;
    f->last_hit = told;
    bus->faults.stale = bus->faults.stale || cw_fault_is_over(f);
    arm_followers(bus, rule, told);
}

/* A match comes. Whether it is its turn, so that only chance can still make it none. */
static inline bool count_match(const cw_bus *bus, cw_fault *f, uint64_t start, uint64_t told)
{
    if (is_gated(bus, f, start))
        return false;
    f->matches++;
    if (f->rule.hold_off > 0 && f->hits > 0 && told - f->last_hit < f->rule.hold_off)
        return false;
    if (f->to_pass == 0)
        return true;
    f->to_pass--;
    return false;
}

static bool draw_match(const cw_bus *bus, cw_fault *f)
{
    if (f->rule.probability == UINT64_MAX)
        return true;
    cw_fault_forget_ahead(bus, f);
    return cw_prng_next(&f->prng) < f->rule.probability;
}

bool cw_fault_takes_match(cw_bus *bus, unsigned rule, uint64_t start, uint64_t told)
{
    cw_fault *f = fault_at(bus, rule);
    if (!count_match(bus, f, start, told))
        return false;
    f->to_pass = f->rule.every - 1;
    if (!draw_match(bus, f))
        return false;
    if (needs_arming(&f->rule))
        f->armed--;
    f->taken++;
    return true;
}

bool cw_fault_passes_over(cw_bus *bus, unsigned rule, uint64_t start, uint64_t told)
{
    cw_fault *f = fault_at(bus, rule);
    if (!count_match(bus, f, start, told))
        return true;
    const cw_prng before = f->prng;
    if (draw_match(bus, f)) {
        f->matches--;
        f->prng = before;
        return false;
    }
    f->to_pass = f->rule.every - 1;
    return true;
}

bool cw_fault_match(cw_bus *bus, unsigned rule, uint64_t start, uint64_t told)
{
    if (!cw_fault_takes_match(bus, rule, start, told))
        return false;
    cw_fault_count_hit(bus, rule, told);
    return true;
}

/* ---- Actions begin and end ------------------------------------------------------------------- */

void cw_fault_wake(cw_bus *bus, unsigned rule)
{
    cw_fault *f = fault_at(bus, rule);
    if (f->awake)
        return;
    f->awake = true;
    list_add(bus->faults.awake, &bus->faults.awake_count, rule);
}

void cw_fault_fall_asleep(cw_bus *bus)
{
    cw_fault_set *set = &bus->faults;
    unsigned kept = 0;
    for (unsigned i = 0; i < set->awake_count; i++) {
        unsigned rule = set->awake[i];
        cw_fault *f = fault_at(bus, rule);
        cw_fault_unbind_ended(bus, f);
        f->awake = f->used && cw_fault_needs_bits(f);
        if (f->awake)
            set->awake[kept++] = (uint16_t)rule;
    }
    set->awake_count = kept;
}

static uint64_t window_end(const cw_bus *bus, const cw_rule *rule)
{
    if (rule->for_ticks)
        return cw_after(cw_now(bus), rule->for_ticks);
    return rule->trigger == CW_TRIGGER_TIME ? rule->time_end : CW_NEVER;
}

static void begin_window(cw_bus *bus, unsigned rule, uint64_t scope)
{
    cw_fault *f = fault_at(bus, rule);
    bool per_attempt = f->rule.action == CW_ACTION_NOISE || f->rule.action == CW_ACTION_NO_ACK;
    f->for_attempt = per_attempt && f->rule.trigger == CW_TRIGGER_FRAME && f->rule.for_ticks == 0;
    f->scope = f->for_attempt ? f->scope | scope : 0;
    f->active = true;
    f->active_until = window_end(bus, &f->rule);
    f->dominant_bits = 0;
    f->next_at = f->rule.action == CW_ACTION_SEND ? cw_now(bus) : CW_NEVER;
    f->busy_base = bus->stats.busy_bits;
    f->bits_base = bus->stats.bits;
    cw_fault_due(bus, f->active_until);
    cw_fault_due(bus, f->next_at);
    if (cw_fault_needs_bits(f))
        cw_fault_wake(bus, rule);
    bus->faults.rewired = bus->faults.rewired || cw_is_topology_action(f->rule.action);
}

void cw_fault_end_action(cw_bus *bus, unsigned rule)
{
    cw_fault *f = fault_at(bus, rule);
    cw_fault_forget_ahead(bus, f);
    f->active = false;
    f->scope = 0;
    f->bound = 0;
    f->bits_left = 0;
    f->to_act = false;
    f->active_until = CW_NEVER;
    cw_fault_let_go(bus, rule);
    if (cw_is_topology_action(f->rule.action))
        cw_fault_apply_topology(bus);
}

static void act(cw_bus *bus, unsigned rule)
{
    if (cw_is_window_action(fault_at(bus, rule)->rule.action))
        begin_window(bus, rule, 0);
    else
        cw_fault_command(bus, rule);
}

/* ---- Frames on the wire ---------------------------------------------------------------------- */

static void encode_offer(bus_node *n, const cw_frame *frame, bool wrong_crc)
{
    if (n->wrong_crc == wrong_crc)
        return;
    n->wrong_crc = wrong_crc;
    (void)cw_bits_encode_crc(&n->mac.tx, frame, wrong_crc ? 1 : 0);
}

/* Whether a rule that is no position action begins to act. The hits of noise are the bits that it
 * flips, so its begin is none. */
static bool begins(cw_bus *bus, unsigned rule, uint64_t start, uint64_t told)
{
    if (fault_at(bus, rule)->rule.action == CW_ACTION_NOISE)
        return cw_fault_takes_match(bus, rule, start, told);
    return cw_fault_match(bus, rule, start, told);
}

/* The rule has a hit and acts when this bit has been settled. */
static void act_later(cw_bus *bus, unsigned rule, uint64_t tick)
{
    fault_at(bus, rule)->to_act = true;
    cw_fault_due(bus, tick);
}

/* A rule that acts at the beginning of a transmission; at most one hit in a bit. What lasts for a
 * time acts in this bit already, for all nodes alike: some have not driven yet. */
static void match_transmission(cw_bus *bus, unsigned rule, unsigned node)
{
    cw_fault *f = fault_at(bus, rule);
    uint64_t told = cw_bit_end(bus);
    bool again = f->hit_now;
    if (!again && !begins(bus, rule, cw_now(bus), told))
        return;
    f->hit_now = f->rule.action != CW_ACTION_NOISE;
    if (cw_is_window_action(f->rule.action))
        begin_window(bus, rule, cw_node_bit(node));
    else
        act_later(bus, rule, told);
    cw_fault_wake(bus, rule); /* to tell the hit at the end of the bit */
}

void cw_fault_transmission(cw_bus *bus, unsigned node, const cw_frame *frame)
{
    bus_node *n = &bus->nodes[node];
    uint64_t self = cw_node_bit(node);
    bool wrong_crc = false;
    for (unsigned i = 0; i < bus->faults.awake_count; i++)
        fault_at(bus, bus->faults.awake[i])->bound &= ~self;
    cw_candidates c;
    unsigned rule;
    cw_candidates_begin(&c, bus, frame);
    while (cw_candidates_next(&c, &rule, bus)) {
        cw_fault *f = fault_at(bus, rule);
        const cw_rule *r = &f->rule;
        if (!cw_fault_names(r->from, self) || !cw_acts_on_wire(r->action))
            continue;
        if (cw_is_position_action(r->action)) {
            f->bound |= cw_fault_is_over(f) ? 0 : self;
            cw_fault_wake(bus, rule);
        } else if (r->action != CW_ACTION_WRONG_CRC) {
            match_transmission(bus, rule, node);
        } else if (cw_fault_names(r->nodes, self) &&
                   (f->hit_now ||
                    cw_fault_match(bus, rule, cw_now(bus), cw_bit_end(bus)))) {
            f->hit_now = true;
            wrong_crc = true;
            cw_fault_wake(bus, rule);
        }
    }
    encode_offer(n, frame, wrong_crc);
}

void cw_fault_emit(cw_bus *bus)
{
    for (unsigned i = 0; i < bus->faults.awake_count; i++) {
        cw_fault *f = fault_at(bus, bus->faults.awake[i]);
        if (f->hit_now)
            cw_push_fault(bus, bus->faults.awake[i], cw_now(bus));
        f->hit_now = false;
    }
    cw_fault_fall_asleep(bus);
}

/* ---- Errors ---------------------------------------------------------------------------------- */

/* Classes of linux/can/error.h. */
static uint32_t error_class(const cw_event *e)
{
    switch (e->kind) {
    case CW_EVENT_ARBITRATION_LOST:
        return 0x002;
    case CW_EVENT_ERROR:
        return e->error.type == CW_ERROR_ACK ? 0x0A8 : 0x088;
    case CW_EVENT_STATE:
        return e->state == CW_STATE_BUS_OFF ? 0x040 : 0x004;
    case CW_EVENT_RESTART:
        return 0x100;
    case CW_EVENT_FAULT:
    case CW_EVENT_LINK:
    case CW_EVENT_DROP:
    case CW_EVENT_TOLERATED:
    case CW_EVENT_OVERLOAD:
    case CW_EVENT_RX:
    case CW_EVENT_TX:
    case CW_EVENT_SKIP:
    case CW_EVENT_COUNT:
        break;
    }
    return 0;
}

/* One rule and errors of these classes. The same error at several nodes is one match. */
static void match_error(cw_bus *bus, unsigned rule, unsigned node, uint32_t classes)
{
    cw_fault *f = fault_at(bus, rule);
    const cw_rule *r = &f->rule;
    if (!f->used || r->trigger != CW_TRIGGER_ERROR || !(r->error_mask & classes) ||
        !cw_fault_names(r->from, cw_node_bit(node)) || f->error_at == cw_now(bus))
        return;
    f->error_at = cw_now(bus);
    if (!begins(bus, rule, cw_now(bus), cw_now(bus)))
        return;
    if (r->action != CW_ACTION_NOISE)
        cw_push_fault(bus, rule, cw_now(bus));
    act_later(bus, rule, cw_now(bus));
}

/* The event lies in the ring, which moves when a fault is told: look at it before. */
void cw_fault_error_now(cw_bus *bus, unsigned node, const cw_event *event)
{
    uint32_t classes = error_class(event);
    if (event->kind == CW_EVENT_STATE && bus->faults.off)
        cw_fault_apply_topology(bus); /* out of bus-off is not back on the bus */
    for (unsigned rule = 0; bus->faults.error_rules && rule < bus->faults.count; rule++)
        match_error(bus, rule, node, classes);
}

/* ---- What is due ----------------------------------------------------------------------------- */

static void fire(cw_bus *bus, unsigned rule)
{
    if (!begins(bus, rule, cw_now(bus), cw_now(bus)))
        return;
    if (fault_at(bus, rule)->rule.action != CW_ACTION_NOISE)
        cw_push_fault(bus, rule, cw_now(bus));
    act(bus, rule);
}

static void arm(cw_bus *bus, unsigned rule)
{
    cw_fault *f = fault_at(bus, rule);
    remove_first_arming(f);
    f->armed_at = cw_now(bus);
    f->armed++;
    if (f->rule.trigger == CW_TRIGGER_ARMED)
        fire(bus, rule);
}

/* One rule at the present tick; returns whether anything was due. */
static bool run_rule(cw_bus *bus, unsigned rule)
{
    cw_fault *f = fault_at(bus, rule);
    bool ends = f->active && f->active_until <= cw_now(bus);
    bool acts = f->to_act;
    bool fires = f->fire_at <= cw_now(bus);
    bool arms = next_arming(f) <= cw_now(bus);
    if (ends)
        cw_fault_end_action(bus, rule);
    f->to_act = false;
    if (acts)
        act(bus, rule);
    if (fires) {
        f->fire_at = CW_NEVER;
        fire(bus, rule);
    }
    if (arms)
        arm(bus, rule);
    return ends || acts || fires || arms;
}

static void find_next_due(cw_bus *bus)
{
    uint64_t next = CW_NEVER;
    for (unsigned rule = 0; rule < bus->faults.count; rule++) {
        const cw_fault *f = fault_at(bus, rule);
        if (!f->used)
            continue;
        next = cw_least(next, cw_least(f->fire_at, next_arming(f)));
        if (f->active)
            next = cw_least(next, cw_least(f->active_until, f->next_at));
    }
    bus->faults.next_due = cw_least(next, cw_fault_next_held(bus));
}

/* Until nothing is due any more: rules may arm each other at the same tick, each one once. */
static void run_rules(cw_bus *bus)
{
    bool again = true;
    while (again) {
        again = false;
        bus->work += 1 + bus->faults.count / RULES_OF_A_PIECE;
        for (unsigned rule = 0; rule < bus->faults.count; rule++)
            if (fault_at(bus, rule)->used)
                again = run_rule(bus, rule) || again;
    }
    if (bus->faults.rewired)
        cw_fault_apply_topology(bus);
}

static bool is_traffic(const cw_fault *f)
{
    return f->used && f->active &&
           (f->rule.action == CW_ACTION_SEND || cw_is_steady_traffic(f->rule.action));
}

/* One node after the other: a drop of an earlier one would have to go before all events of later
 * ones, of which there may be thousands. To the queues it is all the same. */
static void run_traffic(cw_bus *bus)
{
    uint64_t nodes = 0;
    for (unsigned rule = 0; rule < bus->faults.count; rule++)
        if (is_traffic(fault_at(bus, rule)))
            nodes |= cw_node_bit(fault_at(bus, rule)->rule.node);
    for (; nodes; nodes &= nodes - 1)
        for (unsigned rule = 0; rule < bus->faults.count; rule++)
            if (fault_at(bus, rule)->rule.node == cw_lowest_node(nodes) &&
                is_traffic(fault_at(bus, rule)))
                cw_fault_traffic(bus, rule);
}

void cw_fault_run_due(cw_bus *bus)
{
    if (bus->faults.next_due > cw_now(bus) && bus->faults.awake_count == 0)
        return;
    bool due = bus->faults.next_due <= cw_now(bus);
    if (due) {
        run_rules(bus);
        cw_fault_release_held(bus);
    }
    if (due)
        run_traffic(bus);
    bool steady = !due && bus->faults.traffic_rules > 0;
    for (unsigned i = 0; steady && i < bus->faults.awake_count; i++)
        if (fault_at(bus, bus->faults.awake[i])->active)
            cw_fault_traffic(bus, bus->faults.awake[i]);
    if (due)
        find_next_due(bus);
}

/* ---- Adding and clearing --------------------------------------------------------------------- */

static bool nodes_exist(const cw_bus *bus, uint64_t nodes)
{
    return bus->node_count == CW_NODES_MAX || nodes >> bus->node_count == 0;
}

/* Values that have no meaning at all. */
static bool kinds_exist(const cw_rule *r)
{
    return (unsigned)r->trigger <= CW_TRIGGER_ERROR && (unsigned)r->action < CW_ACTION_COUNT &&
           (unsigned)r->field < CW_FIELD_COUNT && (unsigned)r->line <= CW_LINE_RX &&
           (unsigned)r->side <= CW_SIDE_RX && r->filter_count <= CW_RULE_FILTERS_MAX &&
           r->data_length <= 8 && r->name;
}

/* What is needed to know the moment: a frame, a position in it. */
static bool moment_known(const cw_rule *r)
{
    bool needs_frame = cw_is_position_action(r->action) || cw_is_host_action(r->action) ||
                       r->action == CW_ACTION_REPLY || r->action == CW_ACTION_WRONG_CRC;
    bool position = r->field != CW_FIELD_NONE && (r->bits >= 1 || r->for_ticks > 0) &&
                    (r->bits <= CW_PATTERN_MAX || r->action != CW_ACTION_GLITCH);
    return (!needs_frame || r->trigger == CW_TRIGGER_FRAME) &&
           (!cw_is_position_action(r->action) || position);
}

/* Numbers of single actions. */
static bool numbers_in_range(const cw_rule *r)
{
    bool sends = r->action == CW_ACTION_SEND || r->action == CW_ACTION_BABBLE ||
                 r->action == CW_ACTION_REPLY;
    bool counters = (r->tec <= CW_TEC_MAX || r->tec == CW_KEEP) &&
                    (r->rec <= CW_REC_MAX || r->rec == CW_KEEP);
    return (!sends || cw_frame_valid(&r->frame)) &&
           (r->action != CW_ACTION_COUNTERS || counters) &&
           (r->action != CW_ACTION_OVERLOAD || (r->number >= 1 && r->number <= 2)) &&
           (r->action != CW_ACTION_DUPLICATE || r->number <= CW_COPIES_MAX) &&
           (r->action != CW_ACTION_LOAD || r->load_permille <= 1000);
}

static bool settings_fit(const cw_bus *bus, const cw_rule *r)
{
    for (unsigned i = 0; r->action == CW_ACTION_SET && i < bus->node_count; i++)
        if ((r->nodes & cw_node_bit(i)) && !cw_settings_valid(&bus->nodes[i], &r->settings))
            return false;
    return true;
}

/* The rule that it comes after may be added later. */
static bool rule_valid(const cw_bus *bus, const cw_rule *r)
{
    return kinds_exist(r) && moment_known(r) && numbers_in_range(r) &&
           nodes_exist(bus, r->from | r->at | r->nodes | r->state_nodes) &&
           r->node < bus->node_count && settings_fit(bus, r) &&
           (!r->has_after || r->after < bus->faults.capacity);
}

static unsigned free_place(const cw_fault_set *set)
{
    unsigned place = 0;
    while (place < set->count && set->faults[place].used)
        place++;
    return place;
}

/* Counts that let the common cases be passed over quickly. */
static void count_kinds(cw_bus *bus)
{
    cw_fault_set *set = &bus->faults;
    set->host_rules = 0;
    set->reply_rules = 0;
    set->noise_rules = 0;
    set->traffic_rules = 0;
    set->error_rules = 0;
    set->after_rules = 0;
    set->copies = 0;
    for (unsigned i = 0; i < set->count; i++) {
        const cw_fault *f = &set->faults[i];
        set->host_rules += f->used && cw_is_host_action(f->rule.action);
        set->reply_rules += f->used && f->rule.action == CW_ACTION_REPLY;
        set->noise_rules += f->used && f->rule.action == CW_ACTION_NOISE;
        set->traffic_rules += f->used && cw_is_steady_traffic(f->rule.action);
        set->error_rules += f->used && f->rule.trigger == CW_TRIGGER_ERROR;
        set->after_rules += f->used && f->rule.has_after;
        if (f->used && f->rule.action == CW_ACTION_DUPLICATE)
            set->copies += f->rule.number;
    }
    cw_ring_find_enough(bus);
    set->stale = true;
}

cw_status cw_bus_add_rule(cw_bus *bus, unsigned *index, const cw_rule *rule)
{
    cw_fault_set *set = &bus->faults;
    unsigned place = free_place(set);
    if (!rule_valid(bus, rule))
        return CW_INVALID;
    if (place == set->capacity)
        return CW_FULL;
    cw_leap_end(bus); /* it went by the rules that there were */
    if (place == set->count)
        set->count++;
    cw_fault *f = &set->faults[place];
    *f = (cw_fault){.rule = *rule, .used = true, .fire_at = CW_NEVER, .armed_at = CW_NEVER,
                    .error_at = CW_NEVER, .active_until = CW_NEVER, .next_at = CW_NEVER};
    f->rule.name = NULL; /* not ours to keep */
    f->to_pass = rule->skip;
    if (f->rule.every == 0)
        f->rule.every = 1;
    cw_prng_init(&f->prng, bus->seed, rule->name);
    if (rule->trigger == CW_TRIGGER_TIME) {
        f->fire_at = rule->time_begin > cw_now(bus) ? rule->time_begin : cw_now(bus);
        cw_fault_due(bus, f->fire_at);
    }
    index_add(set, place);
    count_kinds(bus);
    *index = place;
    return CW_OK;
}

static bool is_rule(const cw_bus *bus, unsigned index)
{
    return index < bus->faults.count && bus->faults.faults[index].used;
}

cw_status cw_bus_stop_rule(cw_bus *bus, unsigned index)
{
    if (!is_rule(bus, index))
        return CW_INVALID;
    cw_leap_end(bus);
    cw_fault_end_action(bus, index);
    return CW_OK;
}

/* Frames of its traffic that still wait must not be taken for those of a later rule. */
static void disown_frames(cw_bus *bus, unsigned rule)
{
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_queue *q = &bus->nodes[i].queue;
        for (unsigned k = 0; k < q->count; k++)
            if (q->slots[cw_queue_nth(q, k)].source == rule + 1)
                q->slots[cw_queue_nth(q, k)].source = 0;
    }
}

/* Rules that came after a rule that is no more come after none, whatever gets its index. */
static void abandon_followers(cw_bus *bus, unsigned rule)
{
    for (unsigned i = 0; i < bus->faults.count; i++)
        if (bus->faults.faults[i].rule.after == rule)
            bus->faults.faults[i].rule.after = CW_NO_RULE;
}

cw_status cw_bus_clear_rule(cw_bus *bus, unsigned index)
{
    if (!is_rule(bus, index))
        return CW_INVALID;
    cw_leap_end(bus);
    cw_fault_end_action(bus, index);
    disown_frames(bus, index);
    abandon_followers(bus, index);
    index_remove(&bus->faults, index);
    list_remove(bus->faults.awake, &bus->faults.awake_count, index);
    bus->faults.faults[index].used = false;
    bus->faults.faults[index].awake = false;
    count_kinds(bus);
    return CW_OK;
}

cw_status cw_bus_fire_rule(cw_bus *bus, unsigned index)
{
    if (!is_rule(bus, index))
        return CW_INVALID;
    const cw_fault *f = fault_at(bus, index);
    bool ready = f->rule.manual && !cw_fault_is_over(f);
    return ready && add_arming(bus, index, cw_now(bus)) ? CW_OK : CW_REFUSED;
}

/* Its time window is over, or its one moment has come. */
static bool has_passed(const cw_bus *bus, const cw_fault *f)
{
    bool once = f->rule.trigger == CW_TRIGGER_TIME && f->fire_at == CW_NEVER && !f->active;
    return cw_now(bus) >= f->rule.time_end || once;
}

cw_status cw_rule_get_stats(const cw_bus *bus, unsigned rule, cw_rule_stats *stats)
{
    if (!is_rule(bus, rule))
        return CW_INVALID;
    const cw_fault *f = &bus->faults.faults[rule];
    *stats = (cw_rule_stats){.matches = f->matches,
                             .misses = f->matches - f->taken,
                             .hits = f->hits,
                             .active = f->active || f->bits_left > 0,
                             .over = cw_fault_is_over(f) || has_passed(bus, f)};
    return CW_OK;
}
