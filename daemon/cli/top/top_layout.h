/* SPDX-License-Identifier: MIT
 *
 * top_layout.h - the lines of canwire top: from numbers to text, for a screen of any size.
 */
#ifndef CANWIRE_CLI_TOP_TOP_LAYOUT_H
#define CANWIRE_CLI_TOP_TOP_LAYOUT_H

#include "cli/top/top_model.h"

#include <stdbool.h>
#include <stddef.h>

#define TOP_COLUMNS_MIN 40u
#define TOP_COLUMNS_MAX 200u
#define TOP_ROWS_MIN 8u
#define TOP_BUSES_MAX 16u

typedef enum top_style {
    TOP_PLAIN = 0,
    TOP_HEAD,    /* the names of columns */
    TOP_WARNING, /* error-warning, errors */
    TOP_SERIOUS, /* error-passive */
    TOP_DEAD,    /* bus-off, or a bus that is not there */
} top_style;

typedef struct top_line {
    top_style style;
    bool selected;
    char text[TOP_COLUMNS_MAX + 1];
} top_line;

typedef struct top_shown {
    const top_model *model;
    bool there; /* it answers */
} top_shown;

/* The state of the screen. Rows that can be selected are the nodes of the bus, then its rules. */
typedef struct top_view {
    const top_shown *buses;
    unsigned bus_count;
    unsigned bus;      /* its nodes and rules are shown */
    unsigned selected; /* row; TOP_NONE: none */
    bool paused;
    bool help;
    const char *message; /* of the last line; NULL: the keys */
} top_view;

#define TOP_NONE UINT32_MAX

/* Fills `rows` lines of up to `columns` characters. Rows that have no place are scrolled, so that
 * the selected one is seen. Returns the number of lines in use. */
unsigned top_layout(top_line *lines, unsigned rows, unsigned columns, const top_view *view);

/* Returns the number of lines that show all of a view. */
unsigned top_layout_rows(const top_view *view);

/* Draws a bar of `width` characters with its brackets: value of most. */
void top_bar(char *text, unsigned width, int64_t value, int64_t most);

#endif
