/* SPDX-License-Identifier: MIT
 *
 * moment.h - moments of nodes with clocks of their own: spans since an epoch, which moves forward
 * so that they stay below 2^62.
 *
 * A moment that nothing renews any more would go further and further back. So all of them move with
 * cw_moment_rebase(), which has a floor.
 */
#ifndef CANWIRE_TIME_MOMENT_H
#define CANWIRE_TIME_MOMENT_H

#include "canwire.h"

#define CW_SPAN_MAX INT64_MAX           /* a moment that never comes */
#define CW_LONG_AGO (-(INT64_C(1) << 61)) /* one that is before all others */

/* Moves the epoch of a moment forward. A moment of long ago stays long ago, and one that never
 * comes stays so. */
static inline void cw_moment_rebase(cw_span *moment, cw_span by)
{
    if (*moment != CW_SPAN_MAX)
        *moment = *moment < CW_LONG_AGO + by ? CW_LONG_AGO : *moment - by;
}

#endif
