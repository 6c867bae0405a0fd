/* SPDX-License-Identifier: MIT
 *
 * valuetext.h - the value of a factor as people read it.
 */
#ifndef CANWIRE_CAMPAIGN_REPORT_VALUETEXT_H
#define CANWIRE_CAMPAIGN_REPORT_VALUETEXT_H

#include "base/text/buffer.h"
#include "base/text/jsonread.h"

/* Writes a value in place of the text before. A string stays as it is, a fault of a space becomes
 * frame and places, all else JSON. Returns the text. */
const char *value_text(buffer *out, const jsonread_value *value);

/* Returns true for a value of `each-bit` or `pairs-of-bits`. */
bool value_is_space(const jsonread_value *value);

/* Returns the frame of such a value. */
const char *value_frame(const jsonread_value *value);

/* Writes the field, or the two fields, of such a value in place of the text before: "crc", "data
 * stuff", "id + crc". Returns the text. */
const char *value_field(buffer *out, const jsonread_value *value);

#endif
