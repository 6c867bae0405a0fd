/* SPDX-License-Identifier: MIT
 *
 * frame_seen.c - the rest of a frame that traces look at, bit by bit but without controllers.
 *
 * Controllers take the bits of such a frame as long as several nodes send, which see the
 * arbitration in different ways. If the names of bits differ, as with SRR and FDF, they go on up to
 * the DLC. From there on a clean frame follows from its encoding, as in each frame step, and so
 * does what traces see of it.
 */
#include "step/frame.h"

#include "format/bitset.h"
#include "format/frame.h"
#include "mac/mac.h"

/* Returns true for a controller that sends a frame, is not behind its DLC, and asks for nothing
 * else. */
static bool is_sender(const cw_mac *m)
{
    return m->phase == CW_MAC_FRAME && m->part <= CW_PART_DLC && cw_mac_is_sending(m) &&
           !(m->modes & CW_MODES_APART) && !m->sleeps && m->overloads_wanted == 0 &&
           m->reported_state == m->confinement.state;
}

/* Returns true when a sender and its receivers have the same names for the bits up to the DLC, too.
 * No further node can join the frame (M6), and its node wins the arbitration as it should. */
static bool is_plain_head(const cw_bus *bus, unsigned i, const cw_frame *frame)
{
    const cw_bus_node *n = &bus->nodes[i];
    return n->mac.tx_next >= 2 && !cw_frame_is_extended(frame) &&
           (n->mac.protocol & CW_PROTOCOL_MASK) == CW_CLASSICAL &&
           !cw_order_is_improper(bus, i, n->offered_slot);
}

/* Returns true when a node is the only one that sends, all others follow it, and no rule acts on
 * the rest of its frame. */
static bool can_go_on(const cw_bus *bus, unsigned i)
{
    const cw_bus_node *n = &bus->nodes[i];
    if (!is_sender(&n->mac) || n->deviates || bus->rules.awake_count || bus->rules.error_rules ||
        bus->group_count > 1 || bus->pending || bus->dozing || bus->tt)
        return false;
    const cw_frame *frame = cw_queue_at(&n->queue, n->offered_slot)->frame;
    return !cw_frame_is_fd(frame) &&
           (n->mac.part == CW_PART_DLC || is_plain_head(bus, i, frame)) &&
           cw_mac_reads_the_same(&n->mac, &bus->common);
}

/* Finds the bits that do not look like the one before. */
static void find_others(cw_frame_seen *seen, const cw_bits *bits)
{
    uint64_t level = 0, stuff = 0;
    for (unsigned w = 0; w < seen->stuffing.words; w++) {
        const uint64_t l = bits->level[w], s = seen->stuffing.set[w];
        seen->others[w] = (l ^ (l << 1 | level >> 63)) | s | s << 1 | stuff >> 63;
        level = l;
        stuff = s;
    }
}

/* Begins a step in the middle of a frame. Controllers are idle meanwhile. */
static void begin_seen(cw_bus *bus, unsigned i)
{
    cw_bus_node *n = &bus->nodes[i];
    const cw_queue_slot *slot = cw_queue_at(&n->queue, n->offered_slot);
    bus->frame_seen = (cw_frame_seen){.stuffing = cw_bits_stuffing(cw_mac_tx(&n->mac)),
                                      .form = cw_frame_form(slot->frame),
                                      .at = n->mac.tx_next,
                                      .index = n->mac.before_index,
                                      .part = n->mac.before_part};
    find_others(&bus->frame_seen, cw_mac_tx(&n->mac));
    cw_mac_go_behind_frame(&n->mac, CW_ROLE_TRANSMITTER, CW_INTERMISSION_BITS);
    cw_mac_go_behind_frame(&bus->common, CW_ROLE_RECEIVER, CW_INTERMISSION_BITS);
    cw_outlook_find(bus);
    assert(bus->outlook.calm && bus->outlook.listeners == bus->all);
    bus->frame_step.watched = 0;
    bus->frame_step.hit = false;
    bus->frame_step.after_ack = CW_AFTER_ACK_BITS;
    bus->frame_step.fast.to = 0;
    cw_frame_step_prepare(bus, i, cw_node_bit(i));
    bus->frame_step.bits = cw_mac_tx(&n->mac);
    bus->frame_step.stuffing = bus->frame_seen.stuffing;
    bus->frame_step.length = slot->wire_bits;
    bus->frame_step.at = bus->frame_seen.at;
    bus->frame_step.seen = true;
    cw_frame_copy(&bus->frame_step.frame, slot->frame);
}

/* Walks to the next bit. Returns true for a stuff bit. */
static bool walk_on(cw_frame_seen *seen)
{
    if (cw_bitset_get(seen->stuffing.set, seen->at++))
        return true;
    seen->index++;
    while (seen->index >= cw_part_bits((cw_part)seen->part, &seen->form)) {
        seen->part = cw_parts[seen->part].next[0]; /* for 0: IDE and R0, else the same for both */
        seen->index = 0;
    }
    return false;
}

/* Returns where all nodes are in the next bit. Stuff bits are at the bit before them (F7). */
static cw_bit_node next_place(cw_bus *bus)
{
    const cw_frame_step *step = &bus->frame_step;
    cw_frame_seen *seen = &bus->frame_seen;
    bool stuff = false;
    if (step->at >= step->length)
        return (cw_bit_node){.place = {.field = CW_FIELD_INTERMISSION,
                                       .index = (uint16_t)(step->at - step->length)},
                             .phase = CW_MAC_INTERMISSION};
    while (seen->at <= step->at)
        stuff = walk_on(seen);
    cw_bit_node all = {.place = cw_part_place((cw_part)seen->part, seen->index,
                                              cw_frame_is_extended(&step->frame), false),
                       .phase = CW_MAC_FRAME};
    all.place.stuff = stuff;
    return all;
}

/* Takes a bit in which nothing happens and nothing is due, all that most bits are. Returns false,
 * with nothing done, for another one. */
static bool pass_plain_bit(cw_bus *bus)
{
    cw_frame_step *step = &bus->frame_step;
    if (step->at + 1u >= cw_frame_step_acknowledged(step) || cw_first_due(bus) <= cw_bit_end(bus))
        return false;
    step->at++;
    cw_wire_pass(&bus->time, 1);
    cw_frame_step_count_bits(bus, 1);
    bus->note.steady = true;
    return true;
}

bool cw_frame_seen_go(cw_bus *bus)
{
    const uint64_t senders = bus->all & ~bus->followers;
    if (!bus->frame_step.active) {
        if (!bus->followers || senders == 0 || (senders & (senders - 1)) != 0 ||
            !can_go_on(bus, cw_lowest_node(senders)))
            return false;
        begin_seen(bus, cw_lowest_node(senders));
    }
    cw_levels levels = {.driven = ~cw_frame_step_drivers(bus)};
    const cw_bit_node all = next_place(bus);
    cw_find_levels(bus, &levels);
    cw_view_note_sent(bus, &levels, bus->frame_step.node, &all);
    return pass_plain_bit(bus) || cw_frame_step_go(bus, cw_bit_end(bus));
}

/* ---- Bits that look alike -------------------------------------------------------------------- */

/* Returns the bits behind the last one in the same byte of data, or in the same other part. The
 * transmission is over at the end of the last bit of EOF. */
static unsigned left_in_part(const cw_frame_seen *seen)
{
    if (seen->part == CW_PART_DATA)
        return 7 - seen->index % 8;
    const unsigned left = cw_part_bits((cw_part)seen->part, &seen->form) - 1 - seen->index;
    return seen->part == CW_PART_EOF && left > 0 ? left - 1 : left;
}

/* Returns the next bits that look like the last one, as far as they are in one word. */
static unsigned next_alike(const cw_frame_seen *seen, unsigned n)
{
    const uint64_t others = seen->others[n / 64] >> n % 64;
    return others ? (unsigned)__builtin_ctzll(others) : 64 - n % 64;
}

unsigned cw_frame_seen_alike(const cw_bus *bus, uint64_t tick)
{
    const cw_frame_step *step = &bus->frame_step;
    if (step->at >= step->length)
        return 0;
    const uint64_t bits = cw_least(left_in_part(&bus->frame_seen),
                                   next_alike(&bus->frame_seen, step->at));
    if (bits == 0)
        return 0;
    const uint64_t due = cw_host_side_acts(bus) ? cw_first_due(bus)
                                                : cw_least(bus->node_due, bus->rules.next_due);
    const uint64_t most = cw_wire_bits_to(&bus->time, cw_least(tick, due));
    return most > 0 ? (unsigned)cw_least(bits, most - 1) : 0;
}
