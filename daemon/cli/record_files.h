/* SPDX-License-Identifier: MIT
 *
 * record_files.h - checks that canwire record does not write to a file of the bus.
 */
#ifndef CANWIRE_CLI_RECORD_FILES_H
#define CANWIRE_CLI_RECORD_FILES_H

#include "config/config.h"

#include <jansson.h>
#include <stdbool.h>

/* Compares a recording with the files in the status of a bus: its configuration, recordings and
 * journal. Returns false after messages that name both. */
bool record_check_files(const cfg_record *what, const json_t *status);

#endif
