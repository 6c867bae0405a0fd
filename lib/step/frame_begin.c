/* SPDX-License-Identifier: MIT
 *
 * frame_begin.c - whether the frame that comes next can be leapt over, and its start.
 */
#include "step/frame.h"

#include "format/bits.h"
#include "mac/confinement.h"

/* ---- Whether it can begin -------------------------------------------------------------------- */

/* Cheap checks first: in the middle of a frame this is asked for every bit. */
static bool can_begin(cw_bus *bus)
{
    if (bus->waiting == 0 || bus->group_count > 1 || bus->news ||
        (bus->followers && bus->common.phase != CW_MAC_IDLE))
        return false;
    if (!bus->outlook.valid)
        cw_outlook_find(bus);
    if (bus->outlook.calm && bus->rules.awake_count)
        cw_rules_unbind(&bus->rules);
    if (bus->rules.awake_count &&
        ((cw_rules_touch_now(&bus->rules) & CW_TOUCH_CONTROLLERS) ||
         !cw_leap_is_noise_free(bus, 1)))
        return false;
    /* a frame that comes during the SOF may join it (M6) */
    return bus->outlook.calm && cw_inbox_first(bus) > cw_bit_end(bus);
}

/* Rules on errors and states see nothing of a leap in which there are none. */
static bool error_rules_may_act(const cw_bus *bus, uint64_t contenders, unsigned winner)
{
    bool several = (contenders & (contenders - 1)) != 0;
    return bus->rules.error_rules &&
           (several || bus->outlook.counting || bus->nodes[winner].mac.confinement.tec > 0);
}

static bool is_leapable(const cw_bus *bus, uint64_t contenders, unsigned winner)
{
    const cw_outlook *outlook = &bus->outlook;
    uint64_t self = cw_node_bit(winner);
    bool given_up = contenders != self && (contenders & outlook->one_shot); /* M13 */
    return !given_up && !error_rules_may_act(bus, contenders, winner);
}

/* What the controllers have to do themselves: to miss an acknowledgement, to suspend transmission
 * after the intermission (M8). */
static unsigned find_tail(const cw_bus *bus, unsigned winner)
{
    const unsigned from_ack_slot = CW_AFTER_ACK_BITS + 1 + CW_INTERMISSION_BITS;
    if ((bus->outlook.acknowledgers & ~cw_node_bit(winner)) == 0)
        return from_ack_slot;
    bool suspends = cw_confinement_passive(&bus->nodes[winner].mac.confinement);
    return suspends ? CW_INTERMISSION_BITS : 0;
}

/* The frame of a node as the wire would carry it. */
static void encode(bus_node *n)
{
    if (n->wrong_crc)
        n->mac.offered = false;
    cw_offer_first(n);
}

/* ---- Beginning ------------------------------------------------------------------------------- */

/* Whether nothing is due or comes in before that tick. */
static bool is_quiet_until(const cw_bus *bus, uint64_t tick)
{
    return bus->next_restart >= tick && bus->rules.next_due >= tick && cw_inbox_first(bus) >= tick;
}

/* Returns true when the single losses make no event and change nothing; statistics that are read
 * before the end of arbitration leave out those to come (cw_losses_ahead()). With no contender's
 * line in the hands of a rule, the winner's level is that of the wire. */
static bool hides_losses(cw_bus *bus)
{
    const cw_leap *leap = &bus->leap;
    unsigned bits = cw_leap_arbitration_bits(bus);
    return leap->look.bit >= bits &&
           !(leap->at_work && (cw_rules_stuck_lines(&bus->rules) & leap->contenders)) &&
           is_quiet_until(bus, cw_wire_tick(&bus->time, bits)) &&
           !cw_wants_event(bus, CW_EVENT_ARBITRATION_LOST) && cw_leap_is_noise_free(bus, bits);
}

/* Its bits are found only when they are needed. */
static void choose_frame(cw_bus *bus, bool bits)
{
    cw_leap *leap = &bus->leap;
    bus_node *n = &bus->nodes[leap->node];
    if (bits)
        encode(n);
    else
        cw_losses_pin_frame(n);
    const cw_queue_slot *slot = &n->queue.slots[n->offered_slot];
    leap->bits = bits ? &n->mac.tx : NULL;
    leap->length = slot->wire_bits;
    leap->frame = slot->frame;
}

void cw_leap_prepare(cw_bus *bus, unsigned winner, uint64_t contenders)
{
    cw_leap *leap = &bus->leap;
    leap->active = true;
    leap->node = (uint8_t)winner;
    leap->tail = (uint8_t)find_tail(bus, winner);
    leap->broken = false;
    leap->hidden = 0;
    leap->next_loss = UINT8_MAX;
    leap->bound = false;
    leap->at_work = cw_rules_touch(&bus->rules) & CW_TOUCH_LEVELS;
    leap->at = 0;
    leap->look.bit = CW_NO_LOOK;
    leap->listeners = bus->outlook.listeners;
    leap->contenders = contenders;
    leap->undecided = 0;
}

/* All begin to transmit; rules look at the frames of those that are watched. */
static void start_transmissions(cw_bus *bus)
{
    cw_leap *leap = &bus->leap;
    const uint64_t self = cw_node_bit(leap->node);
    const uint64_t watched = leap->watched;
    if (watched == self)
        leap->look = cw_leap_next_look(bus, 0);
    bool hidden = (watched & ~self) == 0 && hides_losses(bus);
    if (leap->contenders == self || hidden) {
        cw_losses_hide(bus);
        return;
    }
    cw_losses_begin(bus);
    for (uint64_t rest = watched & ~self; rest; rest &= rest - 1)
        encode(&bus->nodes[cw_lowest_node(rest)]);
    if (watched)
        leap->look = cw_leap_next_look(bus, 0);
}

bool cw_leap_begin(cw_bus *bus, uint64_t tick)
{
    unsigned winner;
    if (!can_begin(bus))
        return false;
    cw_arbiter_update(bus);
    uint64_t contenders = bus->waiting & bus->outlook.senders;
    bool others = bus->waiting & ~(bus->outlook.listeners | bus->outlook.away);
    if (contenders == 0 || others || !cw_arbiter_winner(bus, contenders, &winner) ||
        !is_leapable(bus, contenders, winner))
        return false;
    uint64_t watched = cw_find_watched(bus, contenders, winner);
    bool at_work = cw_rules_touch(&bus->rules) & CW_TOUCH_LEVELS;
    if (watched && (at_work || cw_rules_act_first(bus, watched)))
        return false;
    const uint64_t losers = contenders & ~cw_node_bit(winner);
    bool losses_seen = losers && cw_wants_event(bus, CW_EVENT_ARBITRATION_LOST);
    bus->error_flag = (flag_watch){.now = false};
    bus->overload_flag = (flag_watch){.now = false};
    bus->leap.watched = watched;
    bool whole = !(watched & losers) && !losses_seen && find_tail(bus, winner) == 0;
    if (whole && cw_leap_whole(bus, winner, contenders, tick))
        return true;
    cw_leap_prepare(bus, winner, contenders);
    bool rough = watched == cw_node_bit(winner) && cw_rules_stop_roughly(&bus->rules, winner);
    choose_frame(bus, (watched && !rough) || losses_seen || bus->leap.at_work);
    start_transmissions(bus);
    return true;
}
