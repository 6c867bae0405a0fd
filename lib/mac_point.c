/* SPDX-License-Identifier: MIT
 *
 * mac_point.c - controllers that are where others are: whether they are, and how they get there.
 *
 * What a controller remembers of the bits of a frame is its point. Receivers without errors are at
 * the same one; where that is follows from the frame and the number of its bits that have passed.
 */
#include "mac_private.h"

#include "bits.h"
#include "codec.h"

#include <assert.h>
#include <string.h>

/* What has been received so far; not memcmp() of all, which would compare padding, too. */
static bool same_received(const cw_frame *a, const cw_frame *b)
{
    return a->id == b->id && a->flags == b->flags && a->dlc == b->dlc &&
           memcmp(a->data, b->data, sizeof a->data) == 0;
}

/* Where in a frame they are, and what they have read of it. */
static bool same_place(const cw_mac *a, const cw_mac *b)
{
    return a->step == b->step && a->index == b->index && a->run == b->run && a->last == b->last &&
           a->before_step == b->before_step && a->before_index == b->before_index &&
           a->may_join == b->may_join && a->crc == b->crc && a->crc_error == b->crc_error &&
           a->shift == b->shift && same_received(&a->rx, &b->rx);
}

/* Idle controllers have no past: cw_mac_begin_frame() sets all that a frame needs. */
bool cw_mac_same_point(const cw_mac *a, const cw_mac *b)
{
    if (a->phase != b->phase || a->role != b->role || cw_mac_is_transmitter(a))
        return false;
    if (a->phase == CW_MAC_IDLE)
        return true;
    return same_place(a, b) && a->count == b->count && a->ack_deferred == b->ack_deferred &&
           a->overloads_in_row == b->overloads_in_row;
}

bool cw_mac_reads_along(const cw_mac *m, const cw_mac *sender)
{
    return m->phase == CW_MAC_FRAME && !cw_mac_is_transmitter(m) && cw_mac_is_sending(sender) &&
           same_place(m, sender);
}

void cw_mac_rest(cw_mac *m)
{
    cw_mac_become_idle(m);
}

void cw_mac_go_to_point(cw_mac *m, const cw_mac *there)
{
    assert(!cw_mac_is_transmitter(there));
    m->phase = there->phase;
    m->role = there->role;
    m->step = there->step;
    m->index = there->index;
    m->before_step = there->before_step;
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
    m->rx = there->rx;
}

/* What has been decoded when a step begins. */
static void decode_up_to(cw_mac *m, const cw_frame *frame)
{
    bool extended = frame->flags & CW_FRAME_EXTENDED;
    if (m->step > CW_STEP_BASE_ID)
        m->rx.id = extended ? frame->id >> 18 : frame->id;
    if (m->step > CW_STEP_SRR_RTR)
        m->rx.flags = extended ? CW_FRAME_REMOTE : frame->flags; /* as if the SRR was an RTR */
    if (m->step > CW_STEP_IDE && extended)
        m->rx.flags |= CW_FRAME_EXTENDED;
    if (m->step > CW_STEP_EXTENDED_ID)
        m->rx.id = frame->id;
    if (m->step > CW_STEP_RTR)
        m->rx.flags = frame->flags;
    if (m->step > CW_STEP_DLC)
        m->rx.dlc = frame->dlc;
    unsigned bytes = m->step > CW_STEP_DATA ? cw_frame_length(frame) : m->index / 8u;
    if (m->step >= CW_STEP_DATA)
        memcpy(m->rx.data, frame->data, bytes);
}

/* CRC and present field from the first n wire bits. */
static void shift_in(cw_mac *m, const cw_bits *bits, unsigned n, unsigned u)
{
    if (m->step >= CW_STEP_CRC)
        m->crc = bits->crc;
    unsigned field = u - m->index; /* where it begins */
    unsigned wire = m->step >= CW_STEP_CRC ? cw_bits_wire_index(bits, field) : 0;
    for (unsigned k = m->step >= CW_STEP_CRC ? field : 0; wire < n; wire++) {
        bool level = cw_bits_level(bits, wire);
        if (cw_bitset_get(bits->stuff, wire))
            continue;
        if (m->step < CW_STEP_CRC)
            m->crc = cw_crc_next(m->crc, level);
        if (k++ >= field)
            m->shift = m->shift << 1 | level;
    }
}

/* Equal levels in a row at the end of the first n wire bits, as far as those are stuffed. */
static void count_run(cw_mac *m, const cw_bits *bits, unsigned n)
{
    const unsigned tail = 3 + CW_EOF_BITS; /* from the CRC delimiter on */
    n = n < bits->length - tail ? n : bits->length - tail;
    m->last = cw_bits_level(bits, n - 1);
    for (m->run = 1; m->run < n && cw_bits_level(bits, n - 1u - m->run) == m->last;)
        m->run++;
}

void cw_mac_go_into_frame(cw_mac *m, const cw_frame *frame, const cw_bits *bits, unsigned n)
{
    cw_mac_begin_frame(m, CW_ROLE_RECEIVER);
    if (n == 0)
        return;
    if (n >= bits->length) {
        cw_mac_enter(m, CW_MAC_INTERMISSION);
        m->count = (uint8_t)(n - bits->length);
        return;
    }
    unsigned u = n - cw_bitset_count_upto(bits->stuff, n - 1);
    m->step = (uint8_t)cw_bits_step(bits, u, &m->index);
    m->before_step = (uint8_t)cw_bits_step(bits, u - 1, &m->before_index);
    m->may_join = n == 1;
    m->crc_error = false;
    m->shift = 0;
    shift_in(m, bits, n, u);
    count_run(m, bits, n);
    decode_up_to(m, frame);
}

void cw_mac_become_transmitter(cw_mac *m, unsigned bits)
{
    m->role = CW_ROLE_TRANSMITTER;
    m->tx_next = (uint8_t)bits;
    m->may_join = false;
}
