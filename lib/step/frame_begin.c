/* SPDX-License-Identifier: MIT
 *
 * frame_begin.c - decides whether the next frame can be a step, and begins it.
 */
#include "step/frame.h"

#include "format/bits.h"
#include "mac/confinement.h"

#define AFTER_CRC_DELIMITER (CW_FD_AFTER_ACK_BITS + 1) /* bits, up to the end of an FD frame */

/* ---- Conditions ------------------------------------------------------------------------------ */

/* Returns true when all frames that wait are plain ones (cw_outlook), and no rule does more than to
 * wait for frames. */
static inline bool waits_plainly(const cw_bus *bus)
{
    return (bus->waiting & ~bus->outlook.plain) == 0 &&
           (bus->rules.awake_count | bus->rules.held_count) == 0;
}

/* Cheap checks come first, since this runs for every bit within a frame. Plain frames need none of
 * them. */
static bool can_begin(cw_bus *bus)
{
    if (bus->group_count > 1 || bus->pending || bus->dozing ||
        (bus->followers && bus->common.phase != CW_MAC_IDLE))
        return false;
    if (!bus->outlook.valid)
        cw_outlook_find(bus);
    if (bus->outlook.calm && bus->rules.awake_count)
        cw_rules_unbind(&bus->rules);
    if (bus->rules.awake_count &&
        ((cw_rules_touch_now(&bus->rules) & CW_TOUCH_CONTROLLERS) ||
         !cw_frame_step_is_noise_free(bus, 1)))
        return false;
    return bus->outlook.calm;
}

/* Rules on errors and states see nothing of a frame that has no errors and changes no state. */
static bool error_rules_may_act(const cw_bus *bus, uint64_t contenders, unsigned winner)
{
    bool several = (contenders & (contenders - 1)) != 0;
    return bus->rules.error_rules &&
           (several || bus->outlook.counting || bus->nodes[winner].mac.confinement.tec > 0);
}

/* Returns true when losers keep their frames (M13) and no rule on errors acts. */
static bool suits_step(const cw_bus *bus, uint64_t contenders, unsigned winner)
{
    const cw_outlook *outlook = &bus->outlook;
    uint64_t self = cw_node_bit(winner);
    bool given_up = contenders != self && (contenders & outlook->one_shot); /* M13 */
    return !given_up && !error_rules_may_act(bus, contenders, winner);
}

/* Returns the number of last bits that the controllers must take themselves. They may miss an
 * acknowledgement, be woken, want overload frames, or suspend transmission after the intermission
 * (M8). */
static unsigned find_tail(const cw_bus *bus, unsigned winner)
{
    const unsigned from_ack_slot = bus->frame_step.after_ack + 1u + CW_INTERMISSION_BITS;
    if ((bus->outlook.acknowledgers & ~cw_node_bit(winner)) == 0 || bus->overload_when_full ||
        bus->listening)
        return from_ack_slot;
    bool suspends = cw_confinement_passive(&bus->nodes[winner].mac.confinement);
    return suspends ? CW_INTERMISSION_BITS : 0;
}

/* Encodes the first frame of a node as the wire would carry it. */
static void encode(cw_bus_node *n)
{
    if (n->deviates)
        n->mac.offered = false;
    cw_offer_first(n);
}

/* ---- Beginning ------------------------------------------------------------------------------- */

/* Returns true when the single losses make no event. Losses that lie ahead are left out when
 * statistics are read (cw_losses_ahead()), and taken back when the step ends before them
 * (cw_losses_show()). When no rule holds the line of a contender, the winner's level is that of the
 * wire. */
static bool hides_losses(const cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    return !cw_wants_event(bus, CW_EVENT_ARBITRATION_LOST) && !bus->tt &&
           !(step->at_work && (cw_rules_stuck_lines(&bus->rules) & step->contenders));
}

/* Finds the bits of the frame only when they are needed. */
static void choose_frame(cw_bus *bus, bool bits)
{
    cw_frame_step *step = &bus->frame_step;
    cw_bus_node *n = &bus->nodes[step->node];
    if (bits)
        encode(n);
    else
        cw_pin_first(n);
    const cw_queue_slot *slot = cw_queue_at(&n->queue, n->offered_slot);
    if (bits)
        cw_frame_step_know(step, cw_mac_tx(&n->mac));
    else
        step->bits = NULL;
    step->length = slot->wire_bits;
    cw_frame_copy(&step->frame, slot->frame);
}

void cw_frame_step_prepare(cw_bus *bus, unsigned winner, uint64_t contenders)
{
    cw_frame_step *step = &bus->frame_step;
    step->active = true;
    step->seen = false;
    step->node = (uint8_t)winner;
    bus->starts[winner].tick = cw_now(bus);
    step->tail = (uint8_t)find_tail(bus, winner);
    step->hidden = 0;
    step->next_loss = UINT8_MAX;
    step->won_at = 0;
    step->at_work = cw_rules_touch(&bus->rules) & CW_TOUCH_LEVELS;
    step->at = 0;
    step->look.bit = CW_NO_LOOK;
    step->listeners = bus->outlook.listeners;
    step->contenders = contenders;
    step->undecided = 0;
    step->counted = CW_NO_RULE;
    step->sure = false;
}

/* Lets all contenders begin to transmit; rules look at the frames of watched nodes. */
static void start_transmissions(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    const uint64_t self = cw_node_bit(step->node);
    const uint64_t watched = step->watched;
    if (watched == self)
        step->look = cw_frame_step_next_look(bus, 0);
    bool hidden = (watched & ~self) == 0 && hides_losses(bus);
    if (step->contenders == self || hidden) {
        cw_losses_hide(bus);
        return;
    }
    cw_losses_begin(bus);
    for (uint64_t rest = watched & ~self; rest; rest &= rest - 1)
        encode(&bus->nodes[cw_lowest_node(rest)]);
    if (watched)
        step->look = cw_frame_step_next_look(bus, 0);
}

/* Prepares an FD frame for the error state that its node has now (D8), which may have changed since
 * the frame was queued or encoded. */
static void refresh_esi(cw_bus_node *n, cw_queue_slot *slot)
{
    const unsigned flags = cw_mac_fd_flags(&n->mac, slot->frame->flags);
    const cw_frame *offered = cw_mac_offered(&n->mac);
    if (slot->frame->flags != flags) {
        slot->frame->flags = (uint8_t)flags;
        slot->wire_bits = cw_bits_measure_fd(slot->frame).bits;
    }
    if (offered && offered->flags != flags)
        n->mac.offered = false;
}

/* Prepares the first frame of the winner on a bus with FD, or with controllers that are of CAN 2.0A
 * or refuse a DLC. On other buses none of this changes. Returns false when the frame is not
 * clean: some node does not know it (D17). It is not inlined, since most buses have neither. */
__attribute__((noinline)) static bool prepare_format(cw_bus *bus, unsigned winner)
{
    cw_bus_node *n = &bus->nodes[winner];
    cw_queue_slot *slot = cw_queue_at(&n->queue, cw_queue_first(&n->queue));
    bus->frame_step.after_ack = CW_AFTER_ACK_BITS;
    bus->frame_step.fast.to = 0;
    if (cw_frame_is_extended(slot->frame) && (bus->old & bus->outlook.listeners))
        return false;
    if (!cw_frame_is_fd(slot->frame) && slot->frame->dlc > CW_CLASSICAL_DATA_MAX)
        return !(bus->strict & bus->outlook.listeners);
    if (!cw_frame_is_fd(slot->frame))
        return true;
    refresh_esi(n, slot);
    bus->frame_step.after_ack = CW_FD_AFTER_ACK_BITS;
    if (bus->timed.rates && (slot->frame->flags & CW_FRAME_BRS))
        bus->frame_step.fast = (cw_fast_part){
            .from = slot->behind_brs, .to = (uint16_t)(slot->wire_bits - AFTER_CRC_DELIMITER)};
    return (bus->outlook.listeners & ~bus->outlook.fd) == 0;
}

/* Returns true when the winner wins though a lower identifier is pending. That one is behind
 * another frame in a queue, or at a node that is cut off. Not inlined, since most nodes send by
 * priority. */
__attribute__((noinline)) static bool wins_improperly(cw_bus *bus, unsigned winner)
{
    cw_order_begin(bus, winner, cw_now(bus));
    return cw_order_is_improper(bus, winner, cw_queue_first(&bus->nodes[winner].queue));
}

/* Finds when the arbitration that the winner has won improperly is over. */
static void find_won(cw_frame_step *step)
{
    const bool extended = cw_frame_is_extended(&step->frame);
    const unsigned end = extended ? CW_EXTENDED_ARBITRATION_END : CW_BASE_ARBITRATION_END;
    step->won_at = (uint8_t)(cw_wire_index(&step->stuffing, end - 1) + 1u);
}

/* Notes the SOF for all that see it, and the start of the slots' frames. */
static void note_times(cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    cw_tt_see_sofs(bus, step->listeners, cw_now(bus));
    for (uint64_t rest = step->contenders; rest; rest &= rest - 1) {
        const unsigned i = cw_lowest_node(rest);
        cw_tt_started(bus, i, cw_queue_first(&bus->nodes[i].queue), cw_now(bus));
    }
}

/* Finds the winner of the next arbitration. Returns all that take part, or 0 when single bits must
 * decide. */
static uint64_t find_contenders(cw_bus *bus, bool plain, unsigned *winner)
{
    const uint64_t replying = plain ? 0 : bus->replying & bus->outlook.senders;
    for (uint64_t rest = replying; rest; rest &= rest - 1)
        cw_mailboxes_load(bus, cw_lowest_node(rest));
    cw_arbiter_update(bus);
    const uint64_t contenders = bus->waiting & bus->outlook.senders;
    if (!plain) {
        const uint64_t unusual = bus->waiting & ~bus->outlook.orderly;
        const uint64_t others = unusual & ~(bus->outlook.listeners | bus->outlook.away);
        if (contenders == 0 || others)
            return 0;
    }
    if (!cw_arbiter_winner(bus, contenders, winner) ||
        (!plain && !suits_step(bus, contenders, *winner)) ||
        (bus->formats_differ && !prepare_format(bus, *winner)))
        return 0;
    return contenders;
}

/* Returns true when rules must see the bits of the next frame one by one. */
static bool rules_need_bits(cw_bus *bus, uint64_t watched)
{
    if (bus->frame_step.fast.to != 0)
        return watched || bus->rules.awake_count;
    if (watched == 0)
        return false;
    const bool at_work = cw_rules_touch(&bus->rules) & CW_TOUCH_LEVELS;
    return at_work || ((watched & bus->rules.early) && cw_rules_act_first(bus, watched));
}

/* Counts the match of the only rule that looks at the frame, when it passes over it. Then no rule
 * looks at the bits. */
static void count_in_advance(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    if (step->watched != cw_node_bit(step->node))
        return;
    step->sure = cw_rules_hit_surely(&bus->rules, step->node);
    if (step->hit || step->sure || !cw_rules_count_off(&bus->rules, step->node))
        return;
    step->counted = bus->rules.watcher[step->node];
    step->watched = 0;
}

/* Begins a step with a frame that does not pass at once. */
static void begin_step(cw_bus *bus, unsigned winner, uint64_t contenders, bool plain)
{
    const bool losses_seen = contenders != cw_node_bit(winner) &&
                             cw_wants_event(bus, CW_EVENT_ARBITRATION_LOST);
    const bool improper = !plain && (bus->waiting & ~bus->outlook.orderly) &&
                          wins_improperly(bus, winner);
    cw_frame_step_prepare(bus, winner, contenders);
    count_in_advance(bus);
    const uint64_t self = cw_node_bit(winner), watched = bus->frame_step.watched;
    const bool rough = watched == self && !bus->frame_step.hit &&
                       cw_rules_stop_roughly(&bus->rules, winner);
    choose_frame(bus, (watched && !rough) || losses_seen || improper || bus->frame_step.at_work);
    if (improper)
        find_won(&bus->frame_step);
    start_transmissions(bus);
    if (bus->tt)
        note_times(bus);
}

bool cw_frame_step_begin(cw_bus *bus, uint64_t tick)
{
    unsigned winner;
    if (bus->waiting == 0)
        return false;
    bool plain = waits_plainly(bus);
    if (!plain) {
        if (!can_begin(bus))
            return false;
        plain = waits_plainly(bus);
    }
    if (cw_inbox_first(bus) <= cw_bit_end(bus)) /* it may join the SOF (M6) */
        return false;
    const uint64_t contenders = find_contenders(bus, plain, &winner);
    if (contenders == 0)
        return false;
    const bool waits = cw_rules_wait_for_frames(&bus->rules);
    const uint64_t watched = waits ? cw_find_watched(bus, contenders, winner) : 0;
    if ((watched || !plain) && rules_need_bits(bus, watched))
        return false;
    bus->error_flag = (cw_flag_watch){.now = false};
    bus->overload_flag = (cw_flag_watch){.now = false};
    bus->frame_step.watched = watched;
    bus->frame_step.hit = false;
    if (plain && (watched & ~cw_node_bit(winner)) == 0 &&
        cw_frame_step_whole(bus, winner, contenders, tick))
        return true;
    begin_step(bus, winner, contenders, plain);
    return true;
}
