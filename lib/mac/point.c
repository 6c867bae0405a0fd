/* SPDX-License-Identifier: MIT
 *
 * point.c - controllers at the same point: tests for it, and ways to get there.
 *
 * The point of a controller is all that it remembers of the bits of a frame. Receivers without
 * errors are at the same point. It follows from the frame and the number of its bits that have
 * passed.
 */
#include "mac/mac_private.h"

#include "format/bits.h"
#include "format/bitset.h"
#include "format/crc.h"
#include "format/layout.h"
#include "format/walk.h"

#include <assert.h>
#include <string.h>

/* Compares the bits received so far, without memcmp() of the whole struct, which would compare
 * padding, too. */
static bool same_received(const cw_frame *a, const cw_frame *b)
{
    const size_t room = cw_frame_is_fd(a) ? CW_FRAME_DATA_MAX : CW_CLASSICAL_DATA_MAX;
    return a->id == b->id && a->flags == b->flags && a->dlc == b->dlc &&
           memcmp(a->data, b->data, room) == 0;
}

/* Compares what FD frames add. A controller that knows them and one that does not are never at the
 * same point: they go on in different ways. */
static bool same_fd_part(const cw_mac *a, const cw_mac *b)
{
    if (!a->fd || !b->fd)
        return a->fd == b->fd && a->protocol == b->protocol;
    return a->protocol == b->protocol && a->fd->crc17 == b->fd->crc17 &&
           a->fd->crc21 == b->fd->crc21 && a->fd->stuff_bits == b->fd->stuff_bits &&
           a->fd->fast == b->fd->fast;
}

/* Compares the places in a frame and the bits read of it. */
static bool same_place(const cw_mac *a, const cw_mac *b)
{
    return a->part == b->part && a->index == b->index && a->run == b->run && a->last == b->last &&
           a->before_part == b->before_part && a->before_index == b->before_index &&
           a->may_join == b->may_join && a->crc == b->crc && a->crc_error == b->crc_error &&
           a->shift == b->shift && same_received(cw_mac_received(a), cw_mac_received(b)) &&
           same_fd_part(a, b);
}

/* Idle controllers remember nothing: cw_mac_begin_frame() sets all that a frame needs. */
bool cw_mac_same_point(const cw_mac *a, const cw_mac *b)
{
    if (a->phase != b->phase || a->role != b->role || cw_mac_is_transmitter(a))
        return false;
    if (a->phase == CW_MAC_IDLE)
        return a->protocol == b->protocol;
    return same_place(a, b) && a->count == b->count && a->ack_deferred == b->ack_deferred &&
           a->overloads_in_row == b->overloads_in_row;
}

bool cw_mac_reads_the_same(const cw_mac *a, const cw_mac *b)
{
    return a->phase == CW_MAC_FRAME && b->phase == CW_MAC_FRAME && same_place(a, b);
}

/* Takes over what only a controller for FD frames remembers of a frame. */
static void go_to_fd_point(cw_fd_part *fd, const cw_fd_part *there)
{
    fd->crc17 = there->crc17;
    fd->crc21 = there->crc21;
    fd->stuff_bits = there->stuff_bits;
    fd->fast = there->fast;
    fd->late_error = 0;
    fd->rx = there->rx; /* with what is behind the data: it is compared, too */
}

void cw_mac_go_to_point(cw_mac *m, const cw_mac *there)
{
    assert(!cw_mac_is_transmitter(there) && m->protocol == there->protocol);
    m->phase = there->phase;
    m->role = there->role;
    m->part = there->part;
    m->index = there->index;
    m->part_bits = there->part_bits;
    m->before_part = there->before_part;
    m->before_index = there->before_index;
    m->count = there->count;
    m->run = there->run;
    m->last = there->last;
    m->driven = there->driven;
    m->started = false;
    m->may_join = there->may_join;
    m->crc_error = there->crc_error;
    m->ack_deferred = there->ack_deferred;
    m->crc = there->crc;
    m->shift = there->shift;
    m->overloads_in_row = there->overloads_in_row;
    if (m->fd)
        go_to_fd_point(m->fd, there->fd);
    else
        m->rx = there->rx;
}

/* Goes to the DLC of a frame at once, with all that the parts before it tell. Returns the number of
 * bits before the DLC. */
static unsigned enter_dlc(cw_mac *m, const cw_frame *frame, unsigned head)
{
    cw_frame *rx = cw_mac_rx(m);
    rx->id = frame->id;
    rx->flags = frame->flags & (CW_FRAME_EXTENDED | CW_FRAME_REMOTE);
    m->part = CW_PART_DLC;
    m->part_bits = CW_DLC_BITS;
    return head - CW_DLC_BITS;
}

/* Walks to the u-th bit that is not a stuff bit, a part at a time. The parts before it have their
 * usual effects. */
static void walk_to(cw_mac *m, const cw_frame *frame, const cw_bits *bits, unsigned u)
{
    const cw_confinement counters = m->confinement;
    cw_mac_report unseen = {.what = 0};
    unsigned length;
    const unsigned head = cw_frame_is_extended(frame) ? CW_EXTENDED_HEAD_BITS : CW_BASE_HEAD_BITS;
    if (u >= head)
        u -= enter_dlc(m, frame, head);
    for (; u >= (length = cw_mac_part_bits(m)); u -= length) {
        const cw_part part = (cw_part)m->part;
        if (part == CW_PART_CRC)
            m->shift = m->crc = (uint16_t)bits->crc;
        else if (part == CW_PART_DATA)
            memcpy(cw_mac_rx(m)->data, frame->data, length / 8);
        else
            m->shift = cw_part_is(part, CW_PART_ACK) ? 0 : cw_part_number(part, frame);
        m->before_part = m->part;
        m->before_index = (uint16_t)(length - 1);
        cw_mac_end_part(m, &unseen);
    }
    m->confinement = counters;
    m->index = (uint16_t)u;
    if (u == 0)
        return;
    m->before_part = m->part;
    m->before_index = (uint16_t)(u - 1);
    if (m->part == CW_PART_DATA)
        memcpy(cw_mac_rx(m)->data, frame->data, u / 8);
}

/* Shifts in the bits of the present part, the last one first. */
static void shift_in(cw_mac *m, const cw_bits *bits, const cw_stuffing *stuffing, unsigned n)
{
    for (unsigned k = 0; k < m->index; n--) {
        if (cw_bitset_get(stuffing->set, n - 1))
            continue;
        if (k < 32)
            m->shift |= (uint32_t)cw_bits_level(bits, n - 1) << k;
        k++;
    }
}

/* Finds the CRC after the first n wire bits. */
static uint16_t find_crc(const cw_bits *bits, const cw_stuffing *stuffing, unsigned n)
{
    uint16_t crc = 0;
    for (unsigned wire = 0; wire < n; wire++)
        if (!cw_bitset_get(stuffing->set, wire))
            crc = cw_crc15_next(crc, cw_bits_level(bits, wire));
    return crc;
}

/* Counts the equal levels in a row at the end of the first n wire bits, as far as those are
 * stuffed. */
static void count_run(cw_mac *m, const cw_bits *bits, unsigned n)
{
    n = n < bits->length - CW_TAIL_BITS ? n : bits->length - CW_TAIL_BITS;
    m->last = cw_bits_level(bits, n - 1);
    for (m->run = 1; m->run < n && cw_bits_level(bits, n - 1u - m->run) == m->last;)
        m->run++;
}

void cw_mac_go_behind_frame(cw_mac *m, cw_role role, unsigned bits)
{
    m->overloads_in_row = 0;
    m->role = (uint8_t)role;
    cw_mac_enter(m, CW_MAC_INTERMISSION);
    m->count = (uint8_t)bits;
    if (bits == CW_INTERMISSION_BITS)
        cw_mac_become_idle(m);
}

/* Takes all bits one by one, since check sequences of FD frames cover stuff bits, too. */
static void replay(cw_mac *m, const cw_bits *bits, unsigned n)
{
    const cw_confinement counters = m->confinement;
    const unsigned ack = bits->length - (cw_bits_is_fd(bits) ? CW_FD_AFTER_ACK_BITS
                                                             : CW_AFTER_ACK_BITS) - 1;
    cw_mac_report unseen;
    for (unsigned wire = 0; wire < n; wire++) {
        m->may_join = wire == 0;
        cw_mac_sample(m, wire != ack && cw_bits_level(bits, wire), &unseen);
    }
    m->confinement = counters;
}

void cw_mac_go_into_frame(cw_mac *m, const cw_frame *frame, const cw_bits *bits,
                          const cw_stuffing *stuffing, unsigned n)
{
    cw_mac_begin_frame(m, CW_ROLE_RECEIVER);
    if (n == 0)
        return;
    if (n >= bits->length) {
        cw_mac_enter(m, CW_MAC_INTERMISSION);
        m->count = (uint8_t)(n - bits->length);
        return;
    }
    if (m->fd) {
        replay(m, bits, n);
        return;
    }
    const unsigned u = n - cw_bitset_count_upto(stuffing->set, n - 1);
    m->may_join = n == 1;
    m->crc_error = false;
    m->shift = 0;
    walk_to(m, frame, bits, u);
    shift_in(m, bits, stuffing, n);
    m->crc = cw_mac_part_is(m, CW_PART_IN_CRC) ? find_crc(bits, stuffing, n)
                                               : (uint16_t)bits->crc;
    count_run(m, bits, n);
}

void cw_mac_become_transmitter(cw_mac *m, unsigned bits)
{
    if (m->fd)
        m->fd->acknowledged = true; /* as in cw_mac_go_into_frame(), if the ACK slot is over (D7) */
    m->role = CW_ROLE_TRANSMITTER;
    m->tx_next = (uint16_t)bits;
    m->may_join = false;
}
