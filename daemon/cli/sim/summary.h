/* SPDX-License-Identifier: MIT
 *
 * summary.h - a bus and its nodes as a small table for people.
 */
#ifndef CANWIRE_CLI_SIM_SUMMARY_H
#define CANWIRE_CLI_SIM_SUMMARY_H

#include "config/config.h"

/* Prints bus time, load and one line for each node. */
void summary_print(FILE *out, const cfg *config, const cw_bus *bus);

#endif
