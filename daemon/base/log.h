/* SPDX-License-Identifier: MIT
 *
 * log.h - messages: to the journal where standard error leads there, else to standard error.
 *
 * In the journal a message has its priority and the fields CANWIRE_BUS and, where it is about one,
 * CANWIRE_NODE. It is sent there without waiting: when the journal takes no more, messages are left
 * out, and their number is told as soon as it does. Safe from any thread.
 */
#ifndef CANWIRE_BASE_LOG_H
#define CANWIRE_BASE_LOG_H

/* The bus that all messages from now on are about; before other threads are started. */
void log_set_bus(const char *bus);

void log_info(const char *format, ...) __attribute__((format(printf, 1, 2)));
void log_warning(const char *format, ...) __attribute__((format(printf, 1, 2)));
void log_error(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* The same about a node; the message begins with its name. */
void log_node_info(const char *node, const char *format, ...) __attribute__((format(printf, 2, 3)));
void log_node_warning(const char *node, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
void log_node_error(const char *node, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* Errors that are complete lines already, such as FILE:LINE:COLUMN: message. */
void log_as_is(const char *lines);

/* The same of warnings. */
void log_warnings(const char *lines);

#endif
