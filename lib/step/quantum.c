/* SPDX-License-Identifier: MIT
 *
 * quantum.c - nodes with clocks of their own, in the order of time: the reference.
 *
 * Each node begins its bits, samples them and ends them by its own clock. The events of a bit come
 * at its end, when its controller goes on to the next one. Nothing is skipped, but nodes look only
 * when it matters: at sample points, and where an edge may have come. Most nodes keep their levels
 * and have nothing to report; they go ahead from one sample point to the next (goes_ahead()). Rules
 * T1 to T12 of RULES.md.
 *
 * In one bit time of the bus (quantum_time.c) a node may have two bits, or none.
 */
#include "step/quantum.h"

#include "mac/late.h"

#include <assert.h>

static cw_timed_node *node_at(cw_bus *bus, unsigned i)
{
    return &bus->timed.nodes[i];
}

/* Returns the moment that many quanta after the start of the node's bit. */
static cw_span after_quanta(const cw_timed_node *n, unsigned quanta)
{
    return n->begin + quanta * n->timing.quantum;
}

/* Returns true when the bit has anything to commit at its end. */
static bool has_report(const cw_timed_node *n)
{
    return (n->report.what & ~CW_REPORT_STARTED) || n->sync_count > 0;
}

/* ---- Edges ----------------------------------------------------------------------------------- */

/* Takes an edge that a look has found. */
static cw_edge_effect take_edge(cw_bus *bus, unsigned i, cw_span look)
{
    cw_timed_node *n = node_at(bus, i);
    const unsigned in = (unsigned)cw_quanta_in(n, look - n->timing.quantum - n->begin);
    const bool hard = cw_mac_synchronises_hard(&bus->nodes[i].mac);
    const int phase_error = (int)in - (n->pcs.sampled ? n->pcs.end_at : 0);
    n->looked = look;
    if (bus->nodes[i].mac.modes & CW_MODE_LOOPBACK) /* M15: it sees none of the wire */
        return CW_EDGE_IGNORED;
    const cw_edge_effect effect = cw_pcs_take_edge(&n->pcs, &n->timing, in, n->driven, hard);
    const unsigned phase = bus->nodes[i].mac.phase;
    if (effect != CW_EDGE_IGNORED && phase != CW_MAC_OFF && phase != CW_MAC_ASLEEP)
        cw_sync_note(bus, i, hard, phase_error, look);
    if (effect != CW_EDGE_IGNORED)
        cw_mac_note_edge(&bus->nodes[i].mac);
    if (effect == CW_EDGE_RESTARTS)
        n->begin = look - n->timing.quantum;
    if (effect == CW_EDGE_ENDS_BIT)
        n->next_begin = look - n->timing.quantum;
    return effect;
}

/* Returns true when no rule may act and no wire swings: all levels follow from edges alone, on one
 * wire. Nothing is marked either. */
static bool is_calm(const cw_bus *bus)
{
    return cw_timed_is_plain(bus) && bus->rules.awake_count == 0 && !bus->timed.marking;
}

/* Ends the calm when rules act after bits have begun or ended, or frames have come in. Nothing else
 * ends it before the next bit time. */
static void check_calm(cw_bus *bus)
{
    if (bus->rules.awake_count || bus->timed.disturbances.count)
        bus->timed.calm = false;
}

/* Notes that the next bit time begins in a different way from the present one. */
static void end_steadiness(cw_bus *bus)
{
    bus->timed.steady_at = CW_NEVER;
}

/* Returns true when a node has nothing to do at the start of its next bit. It keeps its level, and
 * cannot begin to send a frame that comes meanwhile. Such a node drives the bit beforehand. */
static bool goes_ahead(cw_bus *bus, unsigned i, cw_span end)
{
    const cw_timed_node *n = node_at(bus, i);
    return !n->retimed && cw_mac_drives_on(&bus->nodes[i].mac, n->driven) &&
           !cw_timed_compares_late(bus, i) && !cw_timed_changes_rate(bus, i) &&
           !(bus->tt && cw_tt_closes_by(bus, i, end));
}

/* Plans the next bit of a node that has nothing to report at the end of this one. calm: see
 * is_calm(). */
static void plan_next(cw_bus *bus, unsigned i, cw_span end, bool calm)
{
    cw_timed_node *n = node_at(bus, i);
    n->ahead = calm && goes_ahead(bus, i, end);
    if (n->ahead)
        cw_agenda_put(&bus->timed.agenda, i, CW_LOOKS,
                      end + n->to_sample);
    else
        cw_agenda_put(&bus->timed.agenda, i, CW_BEGINS, end);
}

/* Plans what comes after the sample point: the end of the bit, or a look at an edge before. Not
 * inlined, since most samples have no need of it. */
__attribute__((noinline)) static void plan_end(cw_bus *bus, unsigned i)
{
    cw_timed_node *n = node_at(bus, i);
    const cw_span end = after_quanta(n, n->pcs.end_at);
    const cw_span edge = cw_pcs_is_open(&n->pcs) ? cw_timed_next_edge(bus, i, end) : CW_SPAN_MAX;
    n->next_begin = end;
    n->ahead = false;
    if (edge != CW_SPAN_MAX)
        cw_agenda_put(&bus->timed.agenda, i, CW_LOOKS, edge);
    else if (has_report(n))
        cw_agenda_put(&bus->timed.agenda, i, CW_ENDS, end);
    else
        plan_next(bus, i, end, is_calm(bus));
}

/* Plans anew for a node after its sample point, since a dominant level comes before the end of its
 * bit. */
static void plan_anew(cw_bus *bus, unsigned i)
{
    cw_agenda_remove(&bus->timed.agenda, i);
    plan_end(bus, i);
}

/* Notes when a dominant edge arrives. Plans anew for nodes to which it comes before the end of
 * their bits. Nodes before their sample points see it there, also those that have gone ahead. */
static void alert_of_edge(cw_bus *bus, const cw_edge *edge)
{
    const bool rises = bus->timed.cable.dominant == cw_node_bit(edge->node);
    for (unsigned i = 0; i < bus->node_count; i++) {
        cw_timed_node *n = node_at(bus, i);
        const cw_span arrival = cw_cable_arrival(&bus->timed.cable, edge, i);
        cw_timed_note_arrival(n, arrival, rises);
        if (arrival < n->next_begin && n->pcs.sampled && cw_pcs_is_open(&n->pcs))
            plan_anew(bus, i);
    }
}

/* From now on no node goes ahead. */
void cw_timed_alert(cw_bus *bus)
{
    for (unsigned i = 0; i < bus->node_count; i++) {
        const cw_timed_node *n = node_at(bus, i);
        cw_timed_settle(&bus->timed, i);
        if (n->pcs.sampled && cw_pcs_is_open(&n->pcs) && n->next_begin > bus->timed.moment)
            plan_anew(bus, i);
    }
}

/* ---- Begin of a bit -------------------------------------------------------------------------- */

/* Puts a level onto the node's wire, if it differs from the one before. */
static void put_level(cw_bus *bus, unsigned i, bool level, cw_span moment)
{
    cw_timed_node *n = node_at(bus, i);
    if (n->driven == level)
        return;
    n->driven = level;
    if (bus->timed.marking)
        cw_mark_put(bus, CW_MARK_DRIVE, i, moment, level, 0);
    const cw_edge edge = {.moment = moment, .late = cw_rules_edge_delay(&bus->rules, i),
                          .node = (uint8_t)i, .level = level,
                          .ways = bus->timed.cable.ways};
    cw_cable_put(&bus->timed.cable, &edge);
    if (level == CW_DOMINANT)
        alert_of_edge(bus, &edge);
    if (bus->timed.rings || (bus->timed.disturbances.count && level == CW_DOMINANT))
        cw_timed_alert(bus);
}

/* Drives the level of a bit that begins. A frame that has come by then may begin with it. */
static void drive(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_bus_node *n = &bus->nodes[i];
    if (cw_inbox_first(bus) <= cw_tick_of(bus, moment)) { /* it comes at this moment */
        if (bus->rules.hand_in_rules)
            cw_take_inbox_before(bus, cw_tick_of(bus, moment + 1)); /* all that have come */
        else
            cw_take_inbox_of_before(bus, i, cw_tick_of(bus, moment + 1));
        end_steadiness(bus);
    }
    if (bus->tt)
        cw_tt_close_at(bus, i, moment);
    if (n->queue.count > 0 && cw_mac_can_start(&n->mac)) {
        cw_mailboxes_load(bus, i);
        cw_offer_first(n);
    }
    put_level(bus, i, cw_mac_drive(&n->mac), moment);
    if (n->mac.started) {
        end_steadiness(bus);
        cw_note_start(bus, i);
        if (bus->tt)
            cw_tt_started(bus, i, n->offered_slot, cw_tick_of(bus, moment));
    }
}

/* Takes the new bit timing of a node, which its local time follows. Not inlined, since it is
 * rare. */
__attribute__((noinline)) static void retime(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_timed_retime(bus, i);
    end_steadiness(bus);
    if (bus->tt)
        cw_tt_retime(bus, i, cw_instant_after(bus->timed.epoch, moment));
}

/* Begins a bit of a node by its clock, and plans the look at its sample point. */
static void begin_bit(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_timed_node *n = node_at(bus, i);
    if (n->retimed)
        retime(bus, i, moment);
    if (bus->timed.rates)
        cw_timed_begin_at_rate(bus, i);
    cw_timed_begin(n);
    n->looked = moment;
    cw_agenda_put(&bus->timed.agenda, i, CW_LOOKS, after_quanta(n, n->pcs.sample_at));
    drive(bus, i, moment);
    if (bus->timed.marking)
        cw_mark_put(bus, CW_MARK_BEGIN, i, moment, n->driven, 0);
    if (cw_timed_compares_late(bus, i))
        cw_late_begin_bit(&bus->timed.rates[i].late, &bus->nodes[i].mac, bus->nodes[i].mac.driven,
                          moment);
}

/* Begins the bits of all nodes that begin one at a moment. Returns these nodes. */
static uint64_t begin_bits(cw_bus *bus, cw_span moment)
{
    cw_agenda *agenda = &bus->timed.agenda;
    uint64_t nodes = 0;
    const cw_agenda_entry *e;
    while (e = cw_agenda_first(agenda), e->moment == moment && cw_agenda_what(e) == CW_BEGINS) {
        const unsigned i = cw_agenda_node(e);
        cw_agenda_take(agenda, CW_BEGINS);
        begin_bit(bus, i, moment);
        nodes |= cw_node_bit(i);
    }
    return nodes;
}

/* Lets rules on positions act in the bits that have begun. */
static void disturb_bits(cw_bus *bus, uint64_t nodes, cw_span moment)
{
    if (bus->rules.awake_count == 0 && bus->timed.disturbances.count == 0)
        return;
    cw_rules_begin_bits(&bus->rules, &bus->timed.disturbances, nodes, moment,
                        cw_tick_of(bus, moment), ~bus->timed.cable.dominant);
    if (bus->timed.disturbances.count)
        cw_timed_alert(bus);
}

/* ---- Sample point ---------------------------------------------------------------------------- */

/* Returns true when all nodes sample at one moment. */
static bool all_look_at(const cw_agenda *agenda, cw_span moment)
{
    const cw_agenda_list *looks = &agenda->looks, *others = &agenda->others;
    return others->first == others->behind &&
           (looks->first == looks->behind || looks->behind[-1].moment == moment);
}

/* Returns the tick up to which a node takes frames at its sample point. The controller cannot tell
 * when in the bit they come. One that comes behind the bit time can begin with this bit only behind
 * a SOF in intermission (M6). Otherwise it is not taken now: its drop would be an event of a later
 * bit time. */
static uint64_t end_of_frames(const cw_bus *bus, unsigned i, cw_span end_of_bit)
{
    const bool joins = bus->nodes[i].mac.phase == CW_MAC_INTERMISSION &&
                       cw_refusal(bus, i) == CW_DROP_COUNT;
    const uint64_t end = cw_tick_of(bus, end_of_bit);
    return joins ? end : cw_least(end, cw_bit_end(bus));
}

/* Returns the tick at which the present bit of a node ends. Until then the node cannot begin a
 * frame that is queued now. */
static uint64_t end_of_present_bit(cw_bus *bus, unsigned i)
{
    const cw_timed_node *n = node_at(bus, i);
    cw_timed_settle(&bus->timed, i);
    return n->pcs.sampled ? cw_tick_of(bus, n->next_begin) : cw_timed_end_of_bit(bus, i);
}

/* Hands in the frames of all nodes that come before a tick, since rules have to see them in that
 * order. One for a later bit of its node stays: now it might begin in a bit before it comes. Those
 * behind it wait with it. Nor does one come behind the bit time, since its hit would be an event of
 * a later one. So in a rare case a frame that comes behind the sample point does not join a SOF
 * (M6), as it would without such rules. It is handed in with the next bit of its node. */
static void take_in_order(cw_bus *bus, uint64_t tick)
{
    const cw_inbox *box = &bus->inbox;
    const uint64_t end = cw_least(tick, cw_bit_end(bus));
    while (cw_inbox_first(bus) < end &&
           cw_inbox_first(bus) < end_of_present_bit(bus, cw_inbox_at(box, 0)->node))
        cw_take_inbox_first(bus);
}

/* Not inlined, since usually no frame comes. */
__attribute__((noinline)) static void take_some_frames(cw_bus *bus, unsigned i, cw_span moment)
{
    const cw_span end_of_bit = node_at(bus, i)->next_begin;
    if (bus->rules.hand_in_rules)
        take_in_order(bus, cw_tick_of(bus, end_of_bit));
    else if (end_of_bit == cw_moment_of(bus, cw_bit_end(bus)) &&
             all_look_at(&bus->timed.agenda, moment))
        cw_take_inbox_before(bus, cw_bit_end(bus));
    else
        cw_take_inbox_of_before(bus, i, end_of_frames(bus, i, end_of_bit));
    check_calm(bus);
    end_steadiness(bus);
}

/* Hands in the node's frames that come before its next bit. */
static void take_frames(cw_bus *bus, unsigned i, cw_span moment)
{
    if (cw_inbox_first(bus) < cw_tick_of(bus, node_at(bus, i)->next_begin))
        take_some_frames(bus, i, moment);
}

/* Samples at a moment, and plans when the node looks or acts next. */
static void sample(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_timed_node *n = node_at(bus, i);
    cw_mac *m = &bus->nodes[i].mac;
    const cw_mac_phase phase = cw_mac_get_phase(m);
    const bool level = cw_timed_sample(bus, i, moment);
    const bool may_change_rate = bus->timed.rates && phase == CW_MAC_FRAME;
    n->next_begin = may_change_rate ? cw_timed_expected_end(bus, i)
                                    : after_quanta(n, n->pcs.end_at);
    take_frames(bus, i, moment);
    if (cw_timed_compares_late(bus, i))
        cw_timed_compare_late(bus, i, moment);
    if (bus->timed.marking)
        cw_mark_sample(bus, i, moment, level);
    if (bus->tt && phase == CW_MAC_FRAME && m->part == CW_PART_LAST_EOF)
        cw_tt_see_eof_at(bus, i, moment);
    cw_mac_sample(m, level, &n->report);
    if (bus->tt && cw_mac_has_seen_sof(m))
        cw_tt_see_sof_at(bus, i, moment);
    if (bus->timed.counts)
        cw_sync_count_sample(bus, i, level, moment);
    cw_pcs_sampled(&n->pcs, level);
    cw_timed_follow_ears(n, m);
    if (cw_mac_get_phase(m) != phase)
        end_steadiness(bus);
    n->looked = moment;
    if (may_change_rate)
        cw_timed_follow_rate(bus, i, moment);
    if (has_report(n) || (cw_pcs_is_open(&n->pcs) && cw_timed_edge_may_come(bus, n)))
        plan_end(bus, i);
    else
        plan_next(bus, i, n->next_begin, bus->timed.calm);
}

/* Takes all edges up to the sample point, which they may move. */
__attribute__((noinline)) static void take_edges(cw_bus *bus, unsigned i, cw_span moment)
{
    const cw_timed_node *n = node_at(bus, i);
    while (cw_pcs_is_open(&n->pcs)) {
        const cw_span edge = cw_timed_next_edge(bus, i, moment);
        if (edge == CW_SPAN_MAX)
            break;
        (void)take_edge(bus, i, edge);
    }
}

/* Returns true when edges before the sample point must be taken one by one. One on time changes
 * nothing, and the next sample forgets it. Only a hard synchronisation may have to be noted. */
static bool has_edges_to_take(const cw_bus *bus, unsigned i)
{
    const cw_timed *t = &bus->timed;
    const cw_timed_node *n = &t->nodes[i];
    if (!cw_pcs_is_open(&n->pcs) || !cw_timed_edge_may_come(bus, n))
        return false;
    const bool notes = (t->counts || t->reports_syncs) &&
                       cw_mac_synchronises_hard(&bus->nodes[i].mac);
    const bool counts = cw_mac_counts_edges(&bus->nodes[i].mac); /* others may be faster (D20) */
    return notes || counts || !cw_timed_edge_is_on_time(bus, n);
}

/* A node that has gone ahead begins its bit now, when it is about to sample it. */
static void look_before_sample(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_timed_node *n = node_at(bus, i);
    if (n->ahead)
        cw_timed_begin(n);
    n->ahead = false;
    if (has_edges_to_take(bus, i))
        take_edges(bus, i, moment);
    const cw_span point = n->pcs.synchronised ? after_quanta(n, n->pcs.sample_at) : moment;
    if (point > moment)
        cw_agenda_put(&bus->timed.agenda, i, CW_LOOKS, point);
    else
        sample(bus, i, moment);
}

/* Takes the edges up to now, by the last quantum that has ended. They may move the sample point: it
 * is looked for again when the agenda comes there. After a sample there are none up to now. */
void cw_timed_catch_up(cw_bus *bus)
{
    const cw_span now = bus->timed.moment;
    for (unsigned i = 0; bus->timed.active && i < bus->node_count; i++) {
        cw_timed_node *n = node_at(bus, i);
        cw_timed_settle(&bus->timed, i);
        const cw_span looked = after_quanta(n, (unsigned)cw_quanta_in(n, now - n->begin));
        while (!n->pcs.sampled && cw_pcs_is_open(&n->pcs)) {
            const cw_span edge = cw_timed_next_edge(bus, i, looked);
            if (edge == CW_SPAN_MAX)
                break;
            (void)take_edge(bus, i, edge);
        }
        if (looked > n->looked && n->begin <= now)
            n->looked = looked;
    }
}

__attribute__((noinline)) static void look_after_sample(cw_bus *bus, unsigned i, cw_span moment)
{
    const bool edge = cw_timed_next_edge(bus, i, moment) == moment;
    if (edge && take_edge(bus, i, moment) == CW_EDGE_ENDS_BIT)
        cw_agenda_put(&bus->timed.agenda, i, CW_ENDS, moment);
    else
        plan_end(bus, i);
}

/* ---- End of a bit ---------------------------------------------------------------------------- */

/* Commits what the bit has brought, at the tick of its end. */
static void end_bit(cw_bus *bus, unsigned i, cw_span moment)
{
    cw_timed_node *n = node_at(bus, i);
    cw_agenda_put(&bus->timed.agenda, i, CW_BEGINS, moment);
    const uint64_t now = cw_now(bus);
    cw_wire_go_to(&bus->time, cw_tick_of(bus, moment));
    cw_commit_node(bus, i, &n->report);
    cw_sync_commit(bus, i);
    cw_wire_go_to(&bus->time, now);
    n->report.what = 0;
    end_steadiness(bus);
}

uint64_t cw_timed_end_of_bit(const cw_bus *bus, unsigned i)
{
    const cw_timed_node *n = &bus->timed.nodes[i];
    return cw_tick_of(bus, bus->timed.rates ? cw_timed_expected_end(bus, i)
                                            : after_quanta(n, n->pcs.end_at));
}

bool cw_timed_has_report(const cw_bus *bus)
{
    for (unsigned i = 0; bus->timed.active && i < bus->node_count; i++)
        if (has_report(&bus->timed.nodes[i]))
            return true;
    return false;
}

/* ---- Wires that are cut or joined ------------------------------------------------------------ */

/* Puts the nodes onto the wires of the bus. All that came before the moment was on the old ones. */
static void rewire(cw_bus *bus, cw_span moment)
{
    if (cw_timed_forget_wires(bus, moment))
        return;
    cw_timed_catch_up(bus);
    cw_timed_take_wires(bus, moment);
    bus->timed.calm = is_calm(bus);
    cw_timed_alert(bus);
}

/* ---- One bit time ---------------------------------------------------------------------------- */

/* Lets a node look: at its sample point, or where an edge may have come. */
static void quantum_look(cw_bus *bus, unsigned i, cw_span moment)
{
    const cw_timed_node *n = node_at(bus, i);
    cw_agenda_take(&bus->timed.agenda, CW_LOOKS);
    if (n->pcs.sampled && !n->ahead)
        look_after_sample(bus, i, moment);
    else
        look_before_sample(bus, i, moment);
}

__attribute__((noinline)) static void end_or_begin(cw_bus *bus, cw_doing what, unsigned i,
                                                   cw_span moment)
{
    if (what == CW_BEGINS) {
        disturb_bits(bus, begin_bits(bus, moment), moment);
    } else {
        cw_agenda_take(&bus->timed.agenda, CW_ENDS);
        end_bit(bus, i, moment);
    }
    check_calm(bus);
}

/* Does the next thing on the agenda. */
static void quantum_go_on(cw_bus *bus, const cw_agenda_entry *next)
{
    const cw_span moment = next->moment;
    const unsigned i = cw_agenda_node(next);
    bus->timed.moment = moment;
    if (cw_agenda_what(next) == CW_LOOKS)
        quantum_look(bus, i, moment);
    else
        end_or_begin(bus, cw_agenda_what(next), i, moment);
}

/* Rules act on levels. Nodes that they or their hosts have just cut off drive nothing. */
static void disturb(cw_bus *bus, uint64_t nodes, cw_span begin, cw_span end)
{
    cw_disturbances *all = &bus->timed.disturbances;
    if (bus->rules.rewired)
        cw_apply_topology(bus);
    rewire(bus, begin);
    for (uint64_t rest = bus->rules.off & bus->all; rest; rest &= rest - 1)
        put_level(bus, cw_lowest_node(rest), CW_RECESSIVE, begin);
    disturb_bits(bus, nodes, begin);
    cw_rules_begin_bit_time(&bus->rules, all, begin, end);
    if (all->count)
        cw_timed_alert(bus);
}

/* Lets controllers that rules or hosts have changed in the middle of their bits drive anew. */
static void drive_again(cw_bus *bus, cw_span moment)
{
    for (uint64_t rest = bus->timed.touched; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        cw_mac *mac = &bus->nodes[i].mac;
        if (!node_at(bus, i)->pcs.sampled && !cw_mac_can_start(mac))
            put_level(bus, i, cw_mac_drive(mac), moment);
    }
    bus->timed.touched = 0;
}

/* Lets transmitters that have been taken out of the data phase synchronise again. Earlier edges no
 * longer count. */
static void open_ears(cw_bus *bus)
{
    uint64_t opened = 0;
    for (uint64_t rest = bus->timed.touched; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        if (node_at(bus, i)->deaf && cw_mac_synchronises(&bus->nodes[i].mac))
            opened |= cw_node_bit(i);
    }
    if (!opened)
        return;
    cw_timed_catch_up(bus);
    for (uint64_t rest = opened; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        cw_timed_follow_ears(node_at(bus, i), &bus->nodes[i].mac);
    }
    cw_timed_alert(bus);
}

uint64_t cw_timed_begin_bits(cw_bus *bus, cw_span begin)
{
    cw_timed *t = &bus->timed;
    open_ears(bus);
    const bool begins = cw_agenda_first(&t->agenda)->moment == begin;
    const uint64_t nodes = begins ? begin_bits(bus, begin) : 0;
    if (t->touched)
        t->steady_at = CW_NEVER;
    t->touched &= ~nodes;
    drive_again(bus, begin);
    return nodes;
}

void cw_timed_let_rules_act(cw_bus *bus, uint64_t nodes, cw_span begin, cw_span end)
{
    rewire(bus, begin);
    if (bus->rules.awake_count || bus->timed.disturbances.count)
        disturb(bus, nodes, begin, end);
    bus->timed.calm = is_calm(bus);
}

void cw_timed_go_to(cw_bus *bus, cw_span end)
{
    const cw_agenda_entry *e;
    while (e = cw_agenda_first(&bus->timed.agenda),
           e->moment < end || (e->moment == end && cw_agenda_what(e) == CW_LOOKS))
        quantum_go_on(bus, e);
}

void cw_timed_end_bits(cw_bus *bus, cw_span end)
{
    const cw_agenda_entry *e;
    bus->timed.moment = end;
    while (e = cw_agenda_first(&bus->timed.agenda),
           e->moment == end && cw_agenda_what(e) == CW_ENDS)
        end_or_begin(bus, CW_ENDS, cw_agenda_node(e), end);
}
