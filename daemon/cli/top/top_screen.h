/* SPDX-License-Identifier: MIT
 *
 * top_screen.h - the terminal of canwire top, by ncurses.
 */
#ifndef CANWIRE_CLI_TOP_TOP_SCREEN_H
#define CANWIRE_CLI_TOP_TOP_SCREEN_H

#include "cli/top/top_layout.h"

#include <stdbool.h>

typedef enum top_key {
    TOP_KEY_NONE = 0, /* the time is over, or a key without meaning */
    TOP_KEY_UP = 256,
    TOP_KEY_DOWN,
    TOP_KEY_RESIZE,
    TOP_KEY_ENTER,
    TOP_KEY_ERASE,
    TOP_KEY_ESCAPE,
    TOP_KEY_END, /* the terminal has gone */
} top_key; /* or a character */

/* Begins the screen. Returns NULL, or why this terminal cannot have one. */
const char *top_screen_begin(void);
void top_screen_end(void);

void top_screen_size(unsigned *height, unsigned *width);
void top_screen_show(const top_line *text, unsigned count);

/* Waits for a key, up to that many milliseconds. */
int top_screen_key(int wait_ms);

#endif
