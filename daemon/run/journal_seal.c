/* SPDX-License-Identifier: MIT
 *
 * journal_seal.c - the end of each line of a journal: its number and a checksum of the line.
 */
#include "run/journal_seal.h"

#include <assert.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#define CRC_KEY ",\"crc\":\""
#define CRC_DIGITS 8u
#define CRC_END "\"}"
#define TAIL_BYTES (sizeof CRC_KEY - 1 + CRC_DIGITS + sizeof CRC_END - 1)

/* The table is linear: the entry of a byte is the sum of the entries of its bits. */
#define BIT(n, bit, value) ((n) >> (bit) & 1u ? (value) : 0u)
#define ENTRY(n)                                                                                   \
    (BIT(n, 0, 0x77073096u) ^ BIT(n, 1, 0xEE0E612Cu) ^ BIT(n, 2, 0x076DC419u) ^                    \
     BIT(n, 3, 0x0EDB8832u) ^ BIT(n, 4, 0x1DB71064u) ^ BIT(n, 5, 0x3B6E20C8u) ^                    \
     BIT(n, 6, 0x76DC4190u) ^ BIT(n, 7, 0xEDB88320u))
#define ENTRIES_4(n) ENTRY(n), ENTRY((n) + 1u), ENTRY((n) + 2u), ENTRY((n) + 3u)
#define ENTRIES_16(n) ENTRIES_4(n), ENTRIES_4((n) + 4u), ENTRIES_4((n) + 8u), ENTRIES_4((n) + 12u)
#define ENTRIES_64(n)                                                                              \
    ENTRIES_16(n), ENTRIES_16((n) + 16u), ENTRIES_16((n) + 32u), ENTRIES_16((n) + 48u)

static const uint32_t table[256] = {ENTRIES_64(0u), ENTRIES_64(64u), ENTRIES_64(128u),
                                    ENTRIES_64(192u)};

uint32_t journal_crc32(uint32_t before, const void *bytes, size_t size)
{
    const unsigned char *b = bytes;
    uint32_t crc = ~before;
    for (size_t i = 0; i < size; i++)
        crc = table[(crc ^ b[i]) & 0xFFu] ^ crc >> 8;
    return ~crc;
}

size_t journal_seal_put(char *line, size_t size, uint64_t number)
{
    assert(size > 2 && line[size - 2] == '}' && line[size - 1] == '\n');
    size_t used = size - 2;
    used += (size_t)sprintf(line + used, "%s\"n\":%" PRIu64, used > 1 ? "," : "", number);
    uint32_t crc = journal_crc32(0, line, used);
    used += (size_t)sprintf(line + used, CRC_KEY "%08" PRIx32 CRC_END "\n", crc);
    return used;
}

journal_seal journal_seal_check(const char *line, size_t length)
{
    char expected[TAIL_BYTES + 1];
    if (length < TAIL_BYTES)
        return JOURNAL_SEAL_NONE;
    size_t size = length - TAIL_BYTES;
    const char *tail = line + size;
    if (memcmp(tail, CRC_KEY, sizeof CRC_KEY - 1) != 0 ||
        memcmp(tail + TAIL_BYTES - (sizeof CRC_END - 1), CRC_END, sizeof CRC_END - 1) != 0)
        return JOURNAL_SEAL_NONE;
    (void)snprintf(expected, sizeof expected, CRC_KEY "%08" PRIx32 CRC_END,
                   journal_crc32(0, line, size));
    return memcmp(tail, expected, TAIL_BYTES) == 0 ? JOURNAL_SEAL_GOOD : JOURNAL_SEAL_WRONG;
}
