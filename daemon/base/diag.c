/* SPDX-License-Identifier: MIT
 *
 * diag.c - collects the errors of a file and of the files that it names; prints them in order.
 */
#include "base/diag.h"

#include "base/text/plain.h"

#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

static bool is_repeated(const diag *self, const diag_message *message);
static int diag_compare(const void *a, const void *b);
static void print_message(const diag_message *message, FILE *out);
static void __attribute__((format(printf, 2, 3)))
diag_print_line(FILE *out, const char *format, ...);

/* Takes over the text, which is NULL without memory. */
static void diag_keep(diag *self, diag_message message)
{
    message.file = self->file;
    message.number = self->count;
    self->messages[self->count] = message;
    if (is_repeated(self, &message))
        free(message.text);
    else
        self->count++;
}

/* Takes the text over. Beyond the limits errors are only counted; diag_flush() says that there are
 * more. */
static void diag_add_message(diag *self, diag_message message)
{
    self->errors++;
    if (self->count < DIAG_MAX && self->errors <= DIAG_TOLD_MAX) {
        diag_keep(self, message);
        return;
    }
    self->overflow = true;
    free(message.text);
}

void diag_add(diag *self, size_t line, size_t column, const char *format, ...)
{
    diag_message message = {.line = line, .column = column};
    va_list args;

    va_start(args, format);
    if (vasprintf(&message.text, format, args) < 0)
        message.text = NULL;
    va_end(args);
    diag_add_message(self, message);
}

void diag_warn(diag *self, size_t line, size_t column, const char *format, ...)
{
    diag_message message = {.line = line, .column = column, .warning = true};
    va_list args;

    if (self->warnings == DIAG_WARNINGS_MAX || self->count == DIAG_MAX)
        return;
    va_start(args, format);
    if (vasprintf(&message.text, format, args) < 0)
        message.text = NULL;
    va_end(args);
    self->warnings++;
    diag_keep(self, message);
}

void diag_add_elsewhere(diag *self, size_t line, size_t column, const char *text)
{
    diag_add_message(
        self,
        (diag_message){.line = line, .column = column, .elsewhere = true, .text = strdup(text)});
}

diag_file diag_enter(diag *self, const char *name, size_t number)
{
    diag_file before = self->file;

    self->file = (diag_file){.name = name, .number = number};
    return before;
}

void diag_flush(diag *self, FILE *out)
{
    size_t shown = 0;

    qsort(self->messages, self->count, sizeof self->messages[0], diag_compare);
    for (size_t i = 0; i < self->count; i++) {
        bool is_shown = out && (self->errors == 0 || !self->messages[i].warning);

        if (is_shown)
            print_message(&self->messages[i], out);
        shown += is_shown;
        free(self->messages[i].text);
    }
    if (self->overflow && out)
        diag_print_line(out, "%s: there are more errors, only %zu are shown", self->file.name,
                        shown);
    self->errors = 0;
    self->warnings = 0;
    self->count = 0;
    self->overflow = false;
}

/* Finds repeated messages: a profile that is loaded twice reports its errors twice. */
static bool is_repeated(const diag *self, const diag_message *message)
{
    for (size_t i = 0; i < self->count; i++) {
        const diag_message *other = &self->messages[i];

        if (other->line == message->line && other->column == message->column && other->text &&
            message->text && strcmp(other->text, message->text) == 0 &&
            strcmp(other->file.name, message->file.name) == 0)
            return true;
    }
    return false;
}

static int order(size_t a, size_t b)
{
    return (a > b) - (a < b);
}

/* Orders by file, then by place. Messages of one place keep the order in which they came. */
static int diag_compare(const void *a, const void *b)
{
    const diag_message *x = a;
    const diag_message *y = b;
    int result = order(x->file.number, y->file.number);

    if (result == 0)
        result = order(x->line, y->line);
    if (result == 0)
        result = order(x->column, y->column);
    return result != 0 ? result : order(x->number, y->number);
}

/* Prints one line; names of files and texts of clients may contain any characters. */
static void diag_print_line(FILE *out, const char *format, ...)
{
    char *line = NULL;
    va_list args;

    va_start(args, format);
    int length = vasprintf(&line, format, args);
    va_end(args);
    if (length < 0)
        line = NULL;
    if (line)
        plain_make(line, '?');
    fprintf(out, "%s\n", line ? line : "out of memory");
    free(line);
}

/* A message without a line is about the whole file. One from elsewhere has its place in its
 * text. */
static void print_message(const diag_message *message, FILE *out)
{
    const char *text = message->text ? message->text : "out of memory";

    if (message->elsewhere && message->text)
        diag_print_line(out, "%s", text);
    else if (message->line == 0)
        diag_print_line(out, "%s: %s", message->file.name, text);
    else
        diag_print_line(out, "%s:%zu:%zu: %s%s", message->file.name, message->line, message->column,
                        message->warning ? "warning: " : "", text);
}
