/* SPDX-License-Identifier: MIT
 *
 * journal_seal.h - the end of each line of a journal: its number and a checksum of the line.
 *
 *     {"at":160,"fire":"r","n":7,"crc":"1c291ca3"}
 *
 * The checksum is CRC-32 (that of zlib, Ethernet and gzip) of all bytes before `,"crc"`, in eight
 * small hexadecimal digits. It finds each change of up to 32 consecutive bits. Lost lines have
 * numbers, too, so that missing lines are counted.
 */
#ifndef CANWIRE_RUN_JOURNAL_SEAL_H
#define CANWIRE_RUN_JOURNAL_SEAL_H

#include <stddef.h>
#include <stdint.h>

#define JOURNAL_SEAL_BYTES 48 /* of a seal at most, with the final 0 */

typedef enum journal_seal {
    JOURNAL_SEAL_GOOD = 0,
    JOURNAL_SEAL_NONE,
    JOURNAL_SEAL_WRONG
} journal_seal;

uint32_t journal_crc32(uint32_t before, const void *bytes, size_t size);

/* Adds a seal to a line that ends with "}\n" and has room for JOURNAL_SEAL_BYTES more. Returns the
 * new size. */
size_t journal_seal_put(char *line, size_t size, uint64_t number);

/* Checks the seal of a line, which comes without its end. */
journal_seal journal_seal_check(const char *line, size_t length);

#endif
