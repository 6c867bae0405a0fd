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

/* Returns the CRC after one more bit. The CRC begins with 0. */
static inline uint16_t cw_crc15_next(uint16_t crc, bool bit)
{
    bool feedback = bit != ((crc >> (CW_CRC15_BITS - 1)) & 1);
    unsigned shifted = (unsigned)crc << 1;
    return (feedback ? shifted ^ CW_CRC15_POLYNOMIAL : shifted) & ((1u << CW_CRC15_BITS) - 1);
}

#endif
