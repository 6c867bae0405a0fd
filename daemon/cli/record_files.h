/* SPDX-License-Identifier: MIT
 *
 * record_files.h - what canwire record writes is none of the bus' own files.
 */
#ifndef CANWIRE_CLI_RECORD_FILES_H
#define CANWIRE_CLI_RECORD_FILES_H

#include "config/config.h"

#include <jansson.h>
#include <stdbool.h>

/* Compares a recording with the files that the status of a bus names: its configuration, recordings
 * and journal. False after messages that name both. */
bool record_check_files(const cfg_record *what, const json_t *status);

#endif
