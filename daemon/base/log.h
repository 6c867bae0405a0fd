/* SPDX-License-Identifier: MIT
 *
 * log.h - messages: to the journal where standard error leads there, else to standard error.
 *
 * In the journal a message has its priority and the field CANWIRE_BUS, and CANWIRE_NODE when it is
 * about a node. Sending does not wait: a full journal loses messages, and their number is reported
 * as soon as it reads again. The functions are safe from any thread.
 */
#ifndef CANWIRE_BASE_LOG_H
#define CANWIRE_BASE_LOG_H

/* Sets the name of the program; it must stay. Without it that is canwired. */
void log_set_program(const char *name);

/* Sets the bus of all later messages. Call it before other threads are started. */
void log_set_bus(const char *bus);

/* Names the bus of the later messages of this thread, where there are several. A message then
 * begins with the name, which must stay. NULL: none. It does nothing before log_set_rig(). Returns
 * the name before. */
const char *log_enter(const char *bus);

/* Lets log_enter() name buses. Call it before other threads are started. */
void log_set_rig(void);

/* Lets log_detail() log. Call it before other threads are started. */
void log_set_verbose(void);

/* Logs what is needed to look for a fault only. */
void log_detail(const char *format, ...) __attribute__((format(printf, 1, 2)));

void log_info(const char *format, ...) __attribute__((format(printf, 1, 2)));
void log_warning(const char *format, ...) __attribute__((format(printf, 1, 2)));
void log_error(const char *format, ...) __attribute__((format(printf, 1, 2)));

/* Log the same about a node; the message begins with its name. */
void log_node_info(const char *node, const char *format, ...) __attribute__((format(printf, 2, 3)));
void log_node_warning(const char *node, const char *format, ...)
    __attribute__((format(printf, 2, 3)));
void log_node_error(const char *node, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* Logs such an error behind the FILE:LINE:COLUMN that it is about. */
void log_node_error_at(const char *where, const char *node, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Logs errors that are complete lines already, such as FILE:LINE:COLUMN: message. */
void log_as_is(const char *lines);

/* Logs warnings in the same way. */
void log_warnings(const char *lines);

/* Waits until the journal has read all messages, for a second at most. It looks up the unit of each
 * in /proc. It does not find that of a process that is gone, and then `journalctl -u` would not
 * show why that has ended. exit() does it; call it before _exit(). */
void log_end(void);

#define LOG_LAST_BYTES 512

/* Copies the last error, of lines that were logged together the first one; "": none. */
void log_last_error(char out[LOG_LAST_BYTES]);

#endif
