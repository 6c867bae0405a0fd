/* SPDX-License-Identifier: MIT
 *
 * log.h - messages to standard error; under systemd with the priority that the journal reads.
 */
#ifndef CANWIRE_LOG_H
#define CANWIRE_LOG_H

void log_info(const char *format, ...) __attribute__((format(printf, 1, 2)));
void log_warning(const char *format, ...) __attribute__((format(printf, 1, 2)));
void log_error(const char *format, ...) __attribute__((format(printf, 1, 2)));

#endif
