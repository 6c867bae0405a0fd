/* SPDX-License-Identifier: MIT
 *
 * summary.h - a bus and its nodes as a small table for people.
 */
#ifndef CANWIRE_SUMMARY_H
#define CANWIRE_SUMMARY_H

#include "config.h"

/* Bus time, load and one line a node. */
void summary_print(FILE *out, const cfg *config, const cw_bus *bus);

#endif
