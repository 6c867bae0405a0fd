/* SPDX-License-Identifier: MIT
 *
 * crc.h - the check sequence of a frame, bit by bit.
 */
#ifndef CANWIRE_FORMAT_CRC_H
#define CANWIRE_FORMAT_CRC_H

#include <stdbool.h>
#include <stdint.h>

#define CW_CRC15_BITS 15u
#define CW_CRC15_POLYNOMIAL 0x4599u /* without its highest bit (F6) */
#define CW_CRC17_BITS 17u
#define CW_CRC17_POLYNOMIAL 0x1685Bu /* D6 */
#define CW_CRC21_BITS 21u
#define CW_CRC21_POLYNOMIAL 0x102899u

#define CW_STUFF_COUNT_BITS 4u /* with the parity (D5) */

/* Returns a CRC of that many bits after one more bit of the frame. */
static inline uint32_t cw_crc_next(uint32_t crc, bool bit, unsigned bits, uint32_t polynomial)
{
    const bool feedback = bit != ((crc >> (bits - 1)) & 1u);
    const uint32_t shifted = crc << 1;
    return (feedback ? shifted ^ polynomial : shifted) & ((1u << bits) - 1);
}

/* Returns the CRC-15 after one more bit. It begins with 0. */
static inline uint16_t cw_crc15_next(uint16_t crc, bool bit)
{
    return (uint16_t)cw_crc_next(crc, bit, CW_CRC15_BITS, CW_CRC15_POLYNOMIAL);
}

/* Return the CRC-17 and the CRC-21 after one more bit (D6). cw_crc_begin() has the first value. */
static inline uint32_t cw_crc17_next(uint32_t crc, bool bit)
{
    return cw_crc_next(crc, bit, CW_CRC17_BITS, CW_CRC17_POLYNOMIAL);
}

static inline uint32_t cw_crc21_next(uint32_t crc, bool bit)
{
    return cw_crc_next(crc, bit, CW_CRC21_BITS, CW_CRC21_POLYNOMIAL);
}

/* Returns the value with which a CRC of FD frames begins (D6). */
static inline uint32_t cw_crc_begin(unsigned bits, bool non_iso)
{
    return non_iso ? 0 : 1u << (bits - 1);
}

/* Returns the stuff count with its parity: the number of dynamic stuff bits, modulo 8, in Gray code
 * (D5). */
static inline unsigned cw_stuff_count(unsigned stuff_bits)
{
    const unsigned number = stuff_bits % 8;
    const unsigned gray = number ^ number >> 1;
    const unsigned parity = (gray ^ gray >> 1 ^ gray >> 2) & 1u;
    return gray << 1 | parity;
}

#endif
