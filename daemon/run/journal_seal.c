/* SPDX-License-Identifier: MIT
 *
 * journal_seal.c - the end of a line of a journal, and what the traffic of the configuration comes
 *                  to.
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

/* CRC-32 as zlib and Ethernet have it, going on from that of the bytes before. */
uint32_t journal_crc32(uint32_t before, const void *bytes, size_t size)
{
    const unsigned char *b = bytes;
    uint32_t crc = ~before;
    for (size_t i = 0; i < size; i++)
        crc = table[(crc ^ b[i]) & 0xFFu] ^ crc >> 8;
    return ~crc;
}

size_t journal_seal_put(char *line, size_t size, uint64_t number, uint32_t before)
{
    assert(size > 2 && line[size - 2] == '}' && line[size - 1] == '\n');
    size_t used = size - 2;
    used += (size_t)sprintf(line + used, "%s\"n\":%" PRIu64, used > 1 ? "," : "", number);
    uint32_t crc = journal_crc32(before, line, used);
    used += (size_t)sprintf(line + used, CRC_KEY "%08" PRIx32 CRC_END "\n", crc);
    return used;
}

bool journal_seal_is_there(const char *line, size_t length)
{
    const char *tail = line + length - TAIL_BYTES;
    return length >= TAIL_BYTES && memcmp(tail, CRC_KEY, sizeof CRC_KEY - 1) == 0 &&
           memcmp(line + length - (sizeof CRC_END - 1), CRC_END, sizeof CRC_END - 1) == 0;
}

journal_seal journal_seal_check(const char *line, size_t length, uint32_t before)
{
    char expected[TAIL_BYTES + 1];
    if (!journal_seal_is_there(line, length))
        return JOURNAL_SEAL_NONE;
    const size_t size = length - TAIL_BYTES;
    (void)snprintf(expected, sizeof expected, CRC_KEY "%08" PRIx32 CRC_END,
                   journal_crc32(before, line, size));
    return memcmp(line + size, expected, TAIL_BYTES) == 0 ? JOURNAL_SEAL_GOOD : JOURNAL_SEAL_WRONG;
}

/* ---- Digest ---------------------------------------------------------------------------------- */

/* Adds a word so that each of its bits changes about half of all. */
static uint64_t mix(uint64_t digest, uint64_t word)
{
    digest = (digest ^ word) * 0x9E3779B97F4A7C15u;
    return digest ^ digest >> 32;
}

/* Returns eight bytes as a number that is the same on all machines. */
static uint64_t word_at(const uint8_t *bytes)
{
    uint64_t word = 0;
    for (unsigned i = 0; i < 8; i++)
        word |= (uint64_t)bytes[i] << 8 * i;
    return word;
}

uint64_t journal_digest(uint64_t before, unsigned node, const cw_frame *frame, uint64_t tick)
{
    const unsigned room =
        frame->flags & CW_FRAME_FD ? CW_FRAME_DATA_MAX : CW_CLASSICAL_DATA_MAX;
    uint64_t digest = mix(before, tick);
    digest = mix(digest, (uint64_t)frame->id << 32 | (uint64_t)node << 16 |
                             (uint64_t)frame->flags << 8 | frame->dlc);
    for (unsigned i = 0; i < room; i += 8)
        digest = mix(digest, word_at(frame->data + i));
    return digest;
}
