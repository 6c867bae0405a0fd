/* SPDX-License-Identifier: MIT
 *
 * hook.h - what the files of hooks share. A hook is the library's own version of a call of the C
 * library; for other descriptors than CAN sockets it makes the real call.
 */
#ifndef CANWIRE_PRELOAD_HOOK_H
#define CANWIRE_PRELOAD_HOOK_H

#include "preload/hooks/real.h"
#include "preload/table.h"

#include <errno.h>

#define HOOK __attribute__((visibility("default")))

/* Returns what a call returns for 0 or an errno. */
static inline int hook_result(int error)
{
    if (error == 0)
        return 0;
    errno = error;
    return -1;
}

#endif
