/* SPDX-License-Identifier: MIT
 *
 * log.c - messages to standard error; under systemd with the priority that the journal reads.
 */
#include "log.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <systemd/sd-daemon.h>

#define LINE_MAX_BYTES 512

/* One write a message, so that lines of several threads do not mix. */
static void __attribute__((format(printf, 3, 0))) write_line(const char *priority, const char *word,
                                                             const char *format, va_list args)
{
    char line[LINE_MAX_BYTES];
    (void)vsnprintf(line, sizeof line, format, args);
    if (getenv("JOURNAL_STREAM"))
        fprintf(stderr, "%s%s\n", priority, line);
    else
        fprintf(stderr, "canwired: %s%s\n", word, line);
}

void log_info(const char *format, ...)
{
    va_list args;
    va_start(args, format);
    write_line(SD_INFO, "", format, args);
    va_end(args);
}

void log_warning(const char *format, ...)
{
    va_list args;
    va_start(args, format);
    write_line(SD_WARNING, "warning: ", format, args);
    va_end(args);
}

void log_error(const char *format, ...)
{
    va_list args;
    va_start(args, format);
    write_line(SD_ERR, "error: ", format, args);
    va_end(args);
}
