/* SPDX-License-Identifier: MIT
 *
 * rowblock.h - reads the lines of a large file in several processes, and takes them in their order.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_ROWBLOCK_H
#define CANWIRE_CAMPAIGN_REPORT_ROWBLOCK_H

#include "base/text/buffer.h"

#include <stdint.h>

typedef struct rowblock_calls {
    /* Appends what is to be known of a line, in a process of its own. Returns what is wrong with
     * the line, to be freed, or NULL. */
    char *(*read)(void *user, const char *line, size_t length, buffer *digest);
    /* Takes what is known of the next line. Returns false to end the work. */
    bool (*take)(void *user, const char *digest);
    /* Takes what is wrong with the next line, NULL: the file ends in it. Returns false to end the
     * work; a line with a problem ends it in any case. */
    bool (*problem)(void *user, const char *wrong);
} rowblock_calls;

typedef struct rowblock_work {
    const rowblock_calls *calls;
    void *user;
    int fd;        /* of a regular file */
    uint64_t size; /* of it */
    unsigned jobs; /* processes */
} rowblock_work;

/* Returns false when the work has ended early: with errno, or 0 when a call has ended it. */
bool rowblock_read(const rowblock_work *work);

#endif
