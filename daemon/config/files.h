/* SPDX-License-Identifier: MIT
 *
 * files.h - the files that a bus reads and writes, under the names in its configuration.
 */
#ifndef CANWIRE_CONFIG_FILES_H
#define CANWIRE_CONFIG_FILES_H

#include "base/file/fileuse.h"
#include "config/config.h"

/* Add files by texts of the configuration, which must live as long as the uses. */
void cfg_add_files_read(fileuses *all, const cfg *config);    /* itself, profiles, replays */
void cfg_add_files_written(fileuses *all, const cfg *config); /* recordings, report */
void cfg_add_sockets(fileuses *all, const cfg *config);       /* control, virtual time, ports */

/* Returns true when none of these files and sockets, nor of `others` (NULL: none), has another use
 * while it is written. Otherwise it writes one line for each clash to `errors`. */
bool cfg_check_files(const cfg *config, const fileuses *others, const char *program, FILE *errors);

/* Does the same for several configurations together. */
bool cfg_check_all_files(const cfg *const *configs, size_t count, const fileuses *others,
                         const char *program, FILE *errors);

#endif
