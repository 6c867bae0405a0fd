/* SPDX-License-Identifier: MIT
 *
 * journal_pack.h - packs the text of a journal with zstd, and unpacks it again.
 *
 * A packed journal is what `zstd` makes of a text, so `zstdcat` shows it. It consists of frames of
 * JOURNAL_PACK_FRAME bytes of text. Each write has a block of its own: a file that is cut off can
 * be read up to the last whole block. Behind damage the reader goes on with the next frame.
 */
#ifndef CANWIRE_RUN_JOURNAL_PACK_H
#define CANWIRE_RUN_JOURNAL_PACK_H

#include "base/file/spool.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#define JOURNAL_PACK_FRAME (128u * 1024u)
#define JOURNAL_PACK_PIECE 4096u

/* Makes a packer for a spool, which frees it. It needs no more memory later. steady: the same text
 * gives the same file, in any number of writes. Blocks then have JOURNAL_PACK_PIECE bytes of text,
 * and fewer may wait in memory. Returns false without memory. */
bool journal_packer(spool_packer *out, bool steady);

typedef struct journal_unpacker journal_unpacker;

/* Reads a file, packed or not, from a descriptor of the caller. Returns NULL without memory. */
journal_unpacker *journal_unpack(int fd);

/* Frees it. NULL is allowed. */
void journal_unpack_end(journal_unpacker *u);

/* Reads at most `size` bytes of the text. Returns their number, 0 at the end of the file, or -1 and
 * a text in *problem, which stays valid. *damaged: the content of the file is wrong. */
ssize_t journal_unpack_read(journal_unpacker *u, void *text, size_t size, const char **problem,
                            bool *damaged);

/* Goes on behind damage. Returns false when nothing follows. */
bool journal_unpack_go_on(journal_unpacker *u);

/* Returns true for a packed file, when the first bytes have been read. */
bool journal_is_packed(const journal_unpacker *u);

/* Returns how many bytes of the file have been read and used. */
uint64_t journal_unpack_place(const journal_unpacker *u);

/* Returns where the last frame begins in bytes of a packed file, SIZE_MAX: none does. There may be
 * something else. */
size_t journal_pack_last_frame(const char *bytes, size_t size);

#endif
