/* SPDX-License-Identifier: MIT
 *
 * unit.h - the service canwired@INSTANCE, whose unit sets CANWIRE_SERVICE to INSTANCE.
 *
 * It sees other files than its administrator, and how it ends decides whether it is started again.
 */
#ifndef CANWIRE_BASE_UNIT_H
#define CANWIRE_BASE_UNIT_H

#include <stdbool.h>

#define UNIT_RUN_FOLDER "/run/canwire" /* of its control sockets */

/* Returns that folder, or $CANWIRE_RUN. */
const char *unit_run_folder(void);

/* Returns the instance, or NULL when this is not a process of the service. */
const char *unit_instance(void);

/* Returns the exit status of a failure: 1, in the service 75 (EX_TEMPFAIL), after which systemd
 * starts it again. There 1 is for a bad configuration alone, also one whose paths cannot be, see
 * unit_blame(). */
int unit_failure(void);

/* Notes why a path of the configuration could not be made at the start. When another start would
 * find the same, such as a file system that is read-only, the configuration is bad. */
void unit_blame(int number);

/* Ends the start: what fails later is not blamed on the configuration. It ends the reason
 * that unit_failed() has kept. */
void unit_started(void);

/* Keeps the reason of a failure after which systemd starts the service again. ExecStartPre= of the
 * unit says it, since systemd forgets the text of the status. A folder that cannot be written to is
 * no error, as the log has the reason. */
void unit_failed(const char *why);

/* Returns the folder around a path that the service does not see or has of its own. NULL: none, or
 * this is not the service. */
const char *unit_private_folder(const char *path);

/* Returns what to say behind strerror(number) about a path, " (...)" or "". NULL: any path that is
 * written. The text is constant. */
const char *unit_hint(const char *path, int number);

#endif
