/* SPDX-License-Identifier: MIT
 *
 * journal_seal.h - the end of a line of a journal: its number and a checksum. And what the traffic
 * of the configuration comes to.
 *
 *     {"at":160,"fire":"r","n":7,"crc":"1c291ca3"}
 *
 * The checksum is CRC-32 (that of zlib, Ethernet and gzip), in eight small hexadecimal digits. It
 * is that of all bytes before `,"crc"`, from the end of the last line that has one. In versions 2
 * and 3 each line has one; since 4 those of frames mostly have none. It finds each change of up to
 * 32 consecutive bits. Lost lines have numbers, too, so that missing lines are counted.
 */
#ifndef CANWIRE_RUN_JOURNAL_SEAL_H
#define CANWIRE_RUN_JOURNAL_SEAL_H

#include "canwire.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define JOURNAL_SEAL_BYTES 48 /* of a seal at most, with the final 0 */

typedef enum journal_seal {
    JOURNAL_SEAL_GOOD = 0,
    JOURNAL_SEAL_NONE,
    JOURNAL_SEAL_WRONG
} journal_seal;

uint32_t journal_crc32(uint32_t before, const void *bytes, size_t size);

/* Adds a seal to a line that ends with "}\n" and has room for JOURNAL_SEAL_BYTES more. `before` is
 * the checksum of the lines before that have none. Returns the new size. */
size_t journal_seal_put(char *line, size_t size, uint64_t number, uint32_t before);

/* Checks the seal of a line, which comes without its end. */
journal_seal journal_seal_check(const char *line, size_t length, uint32_t before);

/* Returns true for a line with a seal, be it wrong. */
bool journal_seal_is_there(const char *line, size_t length);

/* Returns the digest of the frames that the configuration has released, up to one. Each bit of
 * their data, nodes and ticks counts. The first frame follows 0. */
uint64_t journal_digest(uint64_t before, unsigned node, const cw_frame *frame, uint64_t tick);

#endif
