/* SPDX-License-Identifier: MIT
 *
 * check_doubts.h - warns about a configuration that is valid and still will not do what it says.
 */
#ifndef CANWIRE_CLI_CHECK_DOUBTS_H
#define CANWIRE_CLI_CHECK_DOUBTS_H

#include "config/rig.h"

/* Writes a line per warning, FILE:LINE:COLUMN: warning: message. all: the rig of the bus, or NULL
 * for a bus alone. */
void check_doubts(const cfg *config, const rig *all, size_t bus, FILE *out);

#endif
