/* SPDX-License-Identifier: MIT
 *
 * diag.c - collects the errors of one file and prints them in the order of the file.
 */
#include "diag.h"

#include <stdarg.h>
#include <stdlib.h>

static int compare(const void *a, const void *b);
static void print_message(const diag *self, const diag_message *message, FILE *out);

void diag_add(diag *self, size_t line, size_t column, const char *format, ...)
{
    va_list args;

    if (self->count == DIAG_MAX) {
        self->overflow = true;
        return;
    }
    diag_message *message = &self->messages[self->count];
    *message = (diag_message){.line = line, .column = column, .number = self->count};
    va_start(args, format);
    if (vasprintf(&message->text, format, args) < 0)
        message->text = NULL;
    va_end(args);
    self->count++;
}

void diag_flush(diag *self, FILE *out)
{
    qsort(self->messages, self->count, sizeof self->messages[0], compare);
    for (size_t i = 0; i < self->count; i++) {
        print_message(self, &self->messages[i], out);
        free(self->messages[i].text);
    }
    if (self->overflow)
        fprintf(out, "%s: there are more errors, only %d are shown\n", self->file, DIAG_MAX);
    self->count = 0;
    self->overflow = false;
}

static int order(size_t a, size_t b)
{
    return (a > b) - (a < b);
}

static int compare(const void *a, const void *b)
{
    const diag_message *x = a;
    const diag_message *y = b;
    int result = order(x->line, y->line);

    if (result == 0)
        result = order(x->column, y->column);
    return result != 0 ? result : order(x->number, y->number);
}

static void print_message(const diag *self, const diag_message *message, FILE *out)
{
    const char *text = message->text ? message->text : "out of memory";

    if (message->line == 0)
        fprintf(out, "%s: %s\n", self->file, text);
    else
        fprintf(out, "%s:%zu:%zu: %s\n", self->file, message->line, message->column, text);
}
