/* SPDX-License-Identifier: MIT
 *
 * ecu_folder.h - the folders of a row: one for its files, and a short one for its sockets.
 *
 * The files of row 7 are in WORK/row-7. Paths of sockets have 108 bytes at most, so sockets are in
 * a new folder in $TMPDIR or /tmp. A link leads to it, so that scenario and journal have no name
 * that differs from run to run.
 */
#ifndef CANWIRE_CAMPAIGN_ECU_ECU_FOLDER_H
#define CANWIRE_CAMPAIGN_ECU_ECU_FOLDER_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#define ECU_WHY_MAX 300 /* bytes of a reason with its final 0 */
#define ECU_SCENARIO "scenario.yaml" /* in the folder of a row */
#define ECU_JOURNAL "journal"
#define ECU_RESULT "result.yaml" /* of a program that is the bus by itself */
#define ECU_BUS_LOG "canwired.log"
#define ECU_SOCKETS ".sockets" /* a link to the folder of the sockets, while there is one */

typedef struct ecu_folder {
    int fd;             /* of the files of the row; -1: none */
    char files[PATH_MAX];
    char sockets[PATH_MAX]; /* "": none */
} ecu_folder;

/* Writes the path of the files of a row, in an absolute folder. */
void ecu_folder_path(char out[PATH_MAX], const char *work, uint64_t row);

/* Makes both folders. Files of an earlier run go; other files are left alone, and
 * refused. Returns false after writing the reason. */
bool ecu_folder_make(ecu_folder *f, const char *work, uint64_t row, char why[ECU_WHY_MAX]);

/* Makes a folder in that of the files. Returns false with errno. */
bool ecu_folder_add(const ecu_folder *f, const char *name);

/* Opens a new file in that of the files, to append to it. Returns -1 with errno. */
int ecu_folder_open(const ecu_folder *f, const char *name);

/* Removes the folder of the sockets, and closes the other one. */
void ecu_folder_close(ecu_folder *f);

/* Removes a folder with all that is in it, not following links. */
void ecu_folder_remove(const char *path);

#endif
