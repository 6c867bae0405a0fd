/* SPDX-License-Identifier: MIT
 *
 * protect.h - counters and checksums in the data of frames, beside what canwire.h has of them.
 */
#ifndef CANWIRE_PROTECT_H
#define CANWIRE_PROTECT_H

#include "canwire.h"

/* Returns true when some frame can have the places and the values. */
bool cw_protection_valid(const cw_protection *protection);

/* Inverts the checksum in a frame that has its place. */
void cw_protection_invert(const cw_protection *protection, cw_frame *frame);

#endif
