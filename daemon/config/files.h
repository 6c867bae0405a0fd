/* SPDX-License-Identifier: MIT
 *
 * files.h - the files that a bus reads and writes, as its configuration names them.
 */
#ifndef CANWIRE_CONFIG_FILES_H
#define CANWIRE_CONFIG_FILES_H

#include "base/fileuse.h"
#include "config/config.h"

/* Texts of the configuration, which must live as long as they are used. */
void cfg_add_files_read(fileuses *all, const cfg *config);    /* itself, profiles, replays */
void cfg_add_files_written(fileuses *all, const cfg *config); /* recordings */

/* Whether none of these files, nor of the sockets that the bus makes, nor of `others` (NULL: none),
 * is written that is something else, too. Else one line for each to errors. */
bool cfg_check_files(const cfg *config, const fileuses *others, const char *program, FILE *errors);

#endif
