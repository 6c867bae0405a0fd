/* SPDX-License-Identifier: MIT
 *
 * fd.c - what FD frames add to a controller (D1..D16): check sequences, rates, ESI, comparisons
 * after the sample point.
 */
#include "mac/mac_private.h"

#include "mac/confinement.h"
#include "format/bits.h"
#include "format/crc.h"

#include <string.h>

/* ---- Frames received ------------------------------------------------------------------------- */

void cw_mac_fd_begin(cw_mac *m)
{
    cw_fd_part *fd = m->fd;
    const bool non_iso = m->protocol & CW_PROTOCOL_NON_ISO;
    fd->crc17 = cw_crc_begin(CW_CRC17_BITS, non_iso);
    fd->crc21 = cw_crc_begin(CW_CRC21_BITS, non_iso);
    fd->stuff_bits = 0;
    fd->late_error = 0;
    fd->acknowledged = false;
    m->crc_error = false; /* a non-ISO frame has no stuff count to judge first */
    memset(&fd->rx, 0, sizeof fd->rx);
}

void cw_mac_fd_add_to_crc(cw_fd_part *fd, bool level)
{
    fd->crc17 = cw_crc17_next(fd->crc17, level);
    fd->crc21 = cw_crc21_next(fd->crc21, level);
}

/* An FD frame is never remote: RRS may have either level (D2). */
void cw_mac_fd_take_fdf(cw_mac *m)
{
    const bool non_iso = m->protocol & CW_PROTOCOL_NON_ISO;
    const unsigned extended = m->fd->rx.flags & CW_FRAME_EXTENDED;
    m->fd->rx.flags = (uint8_t)(extended | CW_FRAME_FD | (non_iso ? CW_FRAME_NON_ISO : 0));
}

void cw_mac_fd_take_brs(cw_mac *m)
{
    m->fd->fast = cw_mac_last_level(m);
    m->fd->rx.flags |= m->fd->fast ? CW_FRAME_BRS : 0;
}

void cw_mac_fd_take_esi(cw_mac *m)
{
    m->fd->rx.flags |= cw_mac_last_level(m) ? CW_FRAME_ESI : 0;
}

bool cw_mac_fd_crc_error(const cw_mac *m)
{
    const uint32_t expected =
        cw_mac_part_bits(m) == CW_CRC17_BITS ? m->fd->crc17 : m->fd->crc21;
    return m->crc_error || m->shift != expected;
}

unsigned cw_mac_fd_fixed_number(const cw_mac *m)
{
    const cw_form form = cw_frame_form(&m->fd->rx);
    const unsigned before = m->part == CW_PART_CRC ? cw_part_bits(CW_PART_STUFF_COUNT, &form) : 0;
    return (before + m->index) / CW_FIXED_STUFF_DISTANCE;
}

/* ---- Frames sent ----------------------------------------------------------------------------- */

/* Returns the ESI that the transmitter owes by its counters (D8). */
static unsigned esi_now(const cw_mac *m)
{
    return cw_confinement_passive(&m->confinement) ? CW_FRAME_ESI : 0;
}

unsigned cw_mac_fd_flags(const cw_mac *m, unsigned flags)
{
    const unsigned non_iso = m->protocol & CW_PROTOCOL_NON_ISO ? CW_FRAME_NON_ISO : 0;
    return (flags & ~(CW_FRAME_ESI | CW_FRAME_NON_ISO)) | esi_now(m) | non_iso;
}

void cw_mac_fd_encode(cw_mac *m, const cw_frame *frame, unsigned inverted)
{
    cw_frame *offer = &m->fd->offer;
    cw_frame_copy(offer, frame);
    if (cw_frame_is_fd(offer))
        offer->flags = (uint8_t)cw_mac_fd_flags(m, offer->flags);
    m->fd->inverted = (uint8_t)inverted;
    (void)cw_bits_encode_crc(&m->fd->tx, offer, inverted);
}

/* The bits before ESI stay as they are, and so does their number. */
void cw_mac_fd_renew_esi(cw_mac *m)
{
    cw_frame *offer = &m->fd->offer;
    if (!cw_frame_is_fd(offer) || (offer->flags & CW_FRAME_ESI) == esi_now(m))
        return;
    offer->flags = (uint8_t)cw_mac_fd_flags(m, offer->flags);
    (void)cw_bits_encode_crc(&m->fd->tx, offer, m->fd->inverted);
}

void cw_mac_fd_update_esi(cw_mac *m)
{
    if (cw_mac_sends(m) && m->part == CW_PART_ESI && !cw_mac_stuff_bit_due(m))
        cw_mac_fd_renew_esi(m);
}

bool cw_mac_compares_late(const cw_mac *m)
{
    return m->fd && m->fd->compares_late && m->fd->fast && cw_mac_sends(m) &&
           cw_mac_part_is(m, CW_PART_DATA_RATE);
}

/* Its sample point may lie before the delimiter has come back: the wire still carries the CRC. */
bool cw_mac_passes_delimiter(const cw_mac *m)
{
    return m->fd->compares_late && m->fd->fast && cw_mac_sends(m) &&
           m->part == CW_PART_CRC_DELIMITER;
}

void cw_mac_note_late_error(cw_mac *m, cw_error_type error)
{
    if (!m->fd->late_error && cw_mac_is_fast(m) && cw_mac_sends(m))
        m->fd->late_error = (uint8_t)(1 + error);
}
