/* SPDX-License-Identifier: MIT
 *
 * lack.c - what a lack of memory does to a text that is being made.
 */
#include "embed/embed.h"

#include "base/text/jsonput.h"

static _Thread_local bool lacked; /* each thread makes its own texts, one at a time */

void json_no_memory(void)
{
    lacked = true;
}

void embed_text_begin(void)
{
    lacked = false;
}

bool embed_text_failed(void)
{
    return lacked;
}
