/* SPDX-License-Identifier: MIT
 *
 * skip.c - several bits of one level at once, and the distance of a controller from something new.
 *
 * Flags, delimiters, intermission, idle time and rows of equal bits in a frame take many bits in
 * which a controller only counts. The results are those of mac.c in as many single bits.
 */
#include "mac/mac_private.h"

#include "format/bits.h"
#include "format/tables.h"

#include <assert.h>

/* ---- Bits in which nothing changes but counts ------------------------------------------------ */

/* Returns the level that the controller sees when the wire has a level, with its present own
 * level. */
static bool sees(const cw_mac *m, bool level)
{
    if (!cw_mac_is_hidden(m))
        return level;
    const cw_mac now = {.modes = m->modes, .driven = !cw_mac_in_dominant_flag(m)};
    return cw_mac_visible(&now, level);
}

/* Returns the equal bits that a passive flag has seen, if bits of this level continue them (E7). */
static unsigned flag_bits(const cw_mac *m, bool level)
{
    return m->count && m->last == level ? m->count : 0;
}

/* Returns the bits seen of the delimiter. A controller that waits for the delimiter has seen none
 * (E8). */
static unsigned delimiter_bits(const cw_mac *m)
{
    bool waits = m->phase == CW_MAC_ERROR_WAIT || m->phase == CW_MAC_OVERLOAD_WAIT;
    return waits ? 0 : m->count;
}

/* Returns the bits before the next stuff bit, if bits of this level come. */
static unsigned bits_to_stuff_bit(const cw_mac *m, bool level)
{
    if (cw_mac_has_fixed_stuffing(m))
        return CW_FIXED_STUFF_DISTANCE - m->index % CW_FIXED_STUFF_DISTANCE;
    return CW_STUFF_RUN - (level == m->last ? m->run : 0u);
}

/* Returns a receiver's bits before the last one of the present part, or before a stuff bit. */
static uint64_t steady_frame_bits(const cw_mac *m, bool level)
{
    if (cw_mac_is_transmitter(m) || m->may_join || !cw_mac_part_is(m, CW_PART_STUFFED) ||
        cw_mac_stuff_bit_due(m))
        return 0;
    return cw_least(cw_mac_part_bits(m) - m->index - 1u, bits_to_stuff_bit(m, level));
}

#define TOLERATED_BITS 7u /* dominant bits behind a flag that move no counter (R6) */

/* Returns the bits before a dominant bit that moves a counter (R2, R6). */
static uint64_t tolerated_bits(const cw_mac *m)
{
    bool first = m->count == 0 && m->phase == CW_MAC_ERROR_WAIT && !cw_mac_is_transmitter(m);
    return first ? 0 : TOLERATED_BITS - m->count % 8u;
}

/* Returns the same for a controller in a dominant flag. The flags of others may go on behind its
 * own. One that is hidden sees only its own. */
static uint64_t bits_of_flags(const cw_mac *m)
{
    const bool goes_on = (m->phase == CW_MAC_OVERLOAD_FLAG || cw_mac_is_transmitter(m)) &&
                         !cw_mac_is_hidden(m);
    return CW_FLAG_BITS - (uint64_t)m->count + (goes_on ? TOLERATED_BITS : 0);
}

/* Returns the bits to come, all of them dominant, in which the controller only counts and reports
 * nothing. */
static uint64_t steady_dominant_bits(const cw_mac *m)
{
    switch ((cw_mac_phase)m->phase) {
    case CW_MAC_OFF:
    case CW_MAC_ASLEEP:
    case CW_MAC_INTEGRATING:
        return CW_QUIET_FOREVER;
    case CW_MAC_BUS_OFF:
    case CW_MAC_RECOVERING:
        return m->offered ? 0 : CW_QUIET_FOREVER; /* the drop of the offer is reported */
    case CW_MAC_FRAME:
        return steady_frame_bits(m, CW_DOMINANT);
    case CW_MAC_ERROR_ACTIVE:
    case CW_MAC_OVERLOAD_FLAG:
        return bits_of_flags(m);
    case CW_MAC_ERROR_PASSIVE:
        return m->ack_deferred ? 0 : CW_FLAG_BITS - (uint64_t)flag_bits(m, CW_DOMINANT);
    case CW_MAC_ERROR_WAIT:
    case CW_MAC_OVERLOAD_WAIT:
        return tolerated_bits(m);
    case CW_MAC_IDLE:
    case CW_MAC_ERROR_DELIMITER:
    case CW_MAC_OVERLOAD_DELIMITER:
    case CW_MAC_INTERMISSION:
    case CW_MAC_SUSPEND:
    case CW_MAC_PHASE_COUNT:
        return 0;
    }
    return 0;
}

/* The last bit of the delimiter may lead to an overload frame (O1 a), or to the intermission. */
static uint64_t steady_delimiter_bits(const cw_mac *m)
{
    unsigned left = CW_DELIMITER_BITS - delimiter_bits(m);
    return m->overloads_wanted > 0 ? left - 1 : left + CW_INTERMISSION_BITS;
}

/* Returns all bits but the last one of the last group. An offer is dropped at once. */
static uint64_t steady_recovery_bits(const cw_mac *m)
{
    uint64_t groups = CW_RECOVERY_GROUPS - (uint64_t)m->groups;
    return m->offered ? 0 : CW_INTEGRATION_BITS * groups - m->count - 1;
}

/* Returns the groups of recessive bits that a controller that integrates waits for. */
static uint64_t groups_to_idle(const cw_mac *m)
{
    return m->waits_long ? CW_RECOVERY_GROUPS - (uint64_t)m->groups : 1;
}

/* Returns the same for recessive bits. */
static uint64_t steady_recessive_bits(const cw_mac *m)
{
    switch ((cw_mac_phase)m->phase) {
    case CW_MAC_OFF:
    case CW_MAC_ASLEEP:
        return CW_QUIET_FOREVER;
    case CW_MAC_BUS_OFF:
    case CW_MAC_IDLE:
        return m->offered ? 0 : CW_QUIET_FOREVER;
    case CW_MAC_INTEGRATING:
        return CW_INTEGRATION_BITS * groups_to_idle(m) - m->count;
    case CW_MAC_SUSPEND:
        return CW_SUSPEND_BITS - (uint64_t)m->count;
    case CW_MAC_RECOVERING:
        return steady_recovery_bits(m);
    case CW_MAC_FRAME:
        return steady_frame_bits(m, CW_RECESSIVE);
    case CW_MAC_ERROR_PASSIVE:
        return CW_FLAG_BITS - (uint64_t)flag_bits(m, CW_RECESSIVE);
    case CW_MAC_ERROR_WAIT:
    case CW_MAC_ERROR_DELIMITER:
    case CW_MAC_OVERLOAD_WAIT:
    case CW_MAC_OVERLOAD_DELIMITER:
        return steady_delimiter_bits(m);
    case CW_MAC_INTERMISSION:
        return CW_INTERMISSION_BITS - (uint64_t)m->count;
    case CW_MAC_ERROR_ACTIVE:
    case CW_MAC_OVERLOAD_FLAG:
    case CW_MAC_PHASE_COUNT:
        return 0;
    }
    return 0;
}

/* Returns true when the controller may be asleep after one of its next bits, which is reported. */
static inline bool falls_asleep(const cw_mac *m)
{
    return m->sleeps && cw_mac_is_on_bus(m);
}

uint64_t cw_mac_steady_bits(const cw_mac *m, bool level)
{
    if (m->reported_state != m->confinement.state || falls_asleep(m))
        return 0;
    return sees(m, level) ? steady_recessive_bits(m) : steady_dominant_bits(m);
}

/* ---- Taking them ----------------------------------------------------------------------------- */

/* Takes bits of a frame that are neither stuff bits nor the last one of a part. */
static void skip_frame_bits(cw_mac *m, unsigned bits, bool level)
{
    for (; bits > 0; bits--, m->index++)
        cw_mac_take_bit(m, level);
}

/* Takes bits of a dominant flag, and dominant bits behind it. */
static void skip_dominant_flag(cw_mac *m, unsigned bits)
{
    const unsigned count = m->count + bits;
    m->count = (uint8_t)count;
    if (count < CW_FLAG_BITS)
        return;
    cw_mac_end_flag(m);
    m->count = (uint8_t)(count - CW_FLAG_BITS);
}

/* Takes bits of a passive flag, up to so many in all. */
static void skip_flag(cw_mac *m, unsigned count, bool level)
{
    m->count = (uint8_t)count;
    m->last = level;
    if (m->count == CW_FLAG_BITS)
        cw_mac_end_flag(m);
}

/* Counts up to the end of a phase before idle. */
static void skip_to_idle(cw_mac *m, uint64_t bits, unsigned end)
{
    m->count = (uint8_t)(m->count + bits);
    if (m->count < end)
        return;
    if (m->phase == CW_MAC_INTERMISSION)
        cw_mac_end_intermission(m);
    else
        cw_mac_become_idle(m);
}

/* Takes recessive bits from the wait for a delimiter or from within it. They may go on into the
 * intermission and idle. */
static void skip_delimiter(cw_mac *m, unsigned bits)
{
    bool error = m->phase == CW_MAC_ERROR_WAIT || m->phase == CW_MAC_ERROR_DELIMITER;
    unsigned count = delimiter_bits(m) + bits;
    if (count < CW_DELIMITER_BITS) {
        cw_mac_enter(m, error ? CW_MAC_ERROR_DELIMITER : CW_MAC_OVERLOAD_DELIMITER);
        m->count = (uint8_t)count;
        return;
    }
    cw_mac_enter(m, CW_MAC_INTERMISSION);
    skip_to_idle(m, count - CW_DELIMITER_BITS, CW_INTERMISSION_BITS);
}

/* Takes bits behind a flag: recessive ones begin the delimiter, dominant ones count for R6. */
static void skip_wait(cw_mac *m, unsigned bits, bool level)
{
    if (level)
        skip_delimiter(m, bits);
    else
        m->count = (uint8_t)(m->count + bits);
}

/* Counts groups of eleven recessive bits in bus-off (R12). */
static void skip_recovery(cw_mac *m, uint64_t bits, bool level)
{
    uint64_t seen = level ? m->count + bits : 0;
    m->groups = (uint8_t)(m->groups + seen / CW_INTEGRATION_BITS);
    m->count = (uint8_t)(seen % CW_INTEGRATION_BITS);
}

/* Takes bits of integration. With eleven recessive ones the node is on the bus (M10). */
static void skip_integration(cw_mac *m, uint64_t bits, bool level)
{
    const uint64_t seen = level ? m->count + bits : 0;
    if (seen < CW_INTEGRATION_BITS) {
        m->count = (uint8_t)seen;
        return;
    }
    m->groups = (uint8_t)(m->groups + seen / CW_INTEGRATION_BITS - 1);
    cw_mac_end_integration(m);
    m->count = (uint8_t)(seen % CW_INTEGRATION_BITS);
}

void cw_mac_skip(cw_mac *m, uint64_t bits, bool level)
{
    assert(bits > 0);
    level = sees(m, level);
    switch ((cw_mac_phase)m->phase) {
    case CW_MAC_RECOVERING:
        skip_recovery(m, bits, level);
        break;
    case CW_MAC_INTEGRATING:
        skip_integration(m, bits, level);
        break;
    case CW_MAC_SUSPEND:
        skip_to_idle(m, bits, CW_SUSPEND_BITS);
        break;
    case CW_MAC_INTERMISSION:
        skip_to_idle(m, bits, CW_INTERMISSION_BITS);
        break;
    case CW_MAC_FRAME:
        skip_frame_bits(m, (unsigned)bits, level);
        break;
    case CW_MAC_ERROR_PASSIVE:
        skip_flag(m, flag_bits(m, level) + (unsigned)bits, level);
        break;
    case CW_MAC_ERROR_ACTIVE:
    case CW_MAC_OVERLOAD_FLAG:
        skip_dominant_flag(m, (unsigned)bits);
        break;
    case CW_MAC_ERROR_WAIT:
    case CW_MAC_OVERLOAD_WAIT:
        skip_wait(m, (unsigned)bits, level);
        break;
    case CW_MAC_ERROR_DELIMITER:
    case CW_MAC_OVERLOAD_DELIMITER:
        skip_delimiter(m, (unsigned)bits);
        break;
    case CW_MAC_OFF:
    case CW_MAC_ASLEEP:
    case CW_MAC_BUS_OFF:
    case CW_MAC_IDLE:
    case CW_MAC_PHASE_COUNT:
        break; /* nothing counts */
    }
}

/* ---- Horizon --------------------------------------------------------------------------------- */

/* Returns a transmitter's bits up to the last but one EOF bit, in which the receivers accept the
 * frame, then up to the last. */
static uint64_t bits_to_frame_end(const cw_mac *m)
{
    unsigned left = (unsigned)cw_mac_tx(m)->length - m->tx_next;
    return left > 1 ? left - 1u : left;
}

/* Returns a receiver's bits after the CRC up to the reception. Nothing more comes in the last bit
 * of EOF. */
static uint64_t bits_to_reception(const cw_mac *m)
{
    const uint8_t *at = cw_part_at[cw_format(false, cw_mac_in_fd_frame(m))]; /* the same in extended
                                                                                frames */
    if (m->part == CW_PART_LAST_EOF)
        return CW_QUIET_FOREVER;
    return (unsigned)at[CW_PART_LAST_EOF] - at[m->part] - m->index;
}

uint64_t cw_mac_horizon(const cw_mac *m, bool waiting)
{
    const uint64_t next_frame = falls_asleep(m) ? steady_recessive_bits(m)
                                : waiting       ? CW_FRAME_BITS_MIN - 1
                                                : CW_QUIET_FOREVER;
    switch ((cw_mac_phase)m->phase) {
    case CW_MAC_FRAME:
        if (cw_mac_is_transmitter(m))
            return bits_to_frame_end(m);
        if (!cw_mac_part_is(m, CW_PART_STUFFED))
            return bits_to_reception(m);
        if (m->may_join && waiting)
            return CW_FRAME_BITS_MIN - 2;
        return CW_QUIET_FOREVER; /* the transmitter knows */
    case CW_MAC_RECOVERING:
        return steady_recovery_bits(m) + 1;
    case CW_MAC_ERROR_ACTIVE:
    case CW_MAC_ERROR_PASSIVE:
    case CW_MAC_OVERLOAD_FLAG:
        return CW_FLAG_BITS - (uint64_t)m->count + CW_DELIMITER_BITS;
    case CW_MAC_ERROR_WAIT:
    case CW_MAC_OVERLOAD_WAIT:
        return CW_DELIMITER_BITS;
    case CW_MAC_ERROR_DELIMITER:
    case CW_MAC_OVERLOAD_DELIMITER:
        return CW_DELIMITER_BITS - (uint64_t)m->count;
    case CW_MAC_INTERMISSION:
    case CW_MAC_SUSPEND:
    case CW_MAC_INTEGRATING:
    case CW_MAC_IDLE:
        return next_frame;
    case CW_MAC_OFF:
    case CW_MAC_ASLEEP:
    case CW_MAC_BUS_OFF:
    case CW_MAC_PHASE_COUNT:
        return CW_QUIET_FOREVER;
    }
    return CW_QUIET_FOREVER;
}
