/* SPDX-License-Identifier: MIT
 *
 * top_screen.c - the terminal of canwire top, by ncurses.
 */
#include "cli/top/top_screen.h"

#include <errno.h>
#include <ncurses.h>
#include <stdlib.h>
#include <term.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define ESCAPE 27
#define ERASE 8
#define DELETE 127

static SCREEN *screen;

/* ncurses would end the program where it does not know the terminal. */
static const char *find_terminal(void)
{
    static char place[] = "cup"; /* old versions want it writable */
    int known = 0;
    const char *name = getenv("TERM");
    if (!name || !*name)
        return "TERM is not set: use --once";
    if (setupterm(NULL, STDOUT_FILENO, &known) != OK || known != 1)
        return "the terminal of TERM is not known here: use --once";
    const char *found = tigetstr(place);
    const bool has_cursor = found && found != (const char *)-1;
    (void)del_curterm(cur_term); /* newterm() makes its own */
    return has_cursor ? NULL : "the terminal of TERM has no cursor: use --once";
}

/* The background stays that of the terminal. Without colours, attributes tell lines apart. */
static void choose_colours(void)
{
    if (!has_colors() || start_color() != OK)
        return;
    (void)use_default_colors();
    (void)init_pair(TOP_WARNING, COLOR_YELLOW, -1);
    (void)init_pair(TOP_SERIOUS, COLOR_MAGENTA, -1);
    (void)init_pair(TOP_DEAD, COLOR_RED, -1);
}

const char *top_screen_begin(void)
{
    const char *why = find_terminal();
    if (why)
        return why;
    screen = newterm(NULL, stdout, stdin);
    if (!screen)
        return "the terminal cannot be used: use --once";
    choose_colours();
    (void)cbreak();
    (void)noecho();
    (void)keypad(stdscr, TRUE);
    (void)set_escdelay(50);
    (void)curs_set(0);
    return NULL;
}

void top_screen_end(void)
{
    (void)endwin();
    delscreen(screen);
    screen = NULL;
}

void top_screen_size(unsigned *height, unsigned *width)
{
    *height = (unsigned)getmaxy(stdscr);
    *width = (unsigned)getmaxx(stdscr);
}

/* Returns how a line looks. Without colours bold and reverse must do. */
static attr_t attribute(const top_line *line)
{
    const attr_t colour = has_colors() ? (attr_t)COLOR_PAIR((int)line->style) : 0;
    attr_t base = colour;
    if (line->style == TOP_PLAIN)
        base = A_NORMAL;
    if (line->style == TOP_HEAD)
        base = A_BOLD;
    if (line->style == TOP_DEAD)
        base = colour | A_BOLD;
    return base | (line->selected ? A_REVERSE : 0);
}

/* Lines have at most the width of the screen, which ncurses would wrap otherwise. */
void top_screen_show(const top_line *text, unsigned count)
{
    (void)erase();
    for (unsigned i = 0; i < count; i++) {
        (void)attrset((int)attribute(&text[i]));
        (void)mvaddstr((int)i, 0, text[i].text);
    }
    (void)attrset(A_NORMAL);
    (void)refresh();
}

/* Follows the size of the terminal, also when ncurses has missed the signal or goes by COLUMNS of
 * the environment. Returns true when it has changed. */
static bool follow_size(void)
{
    struct winsize size;
    if (ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_row == 0 || size.ws_col == 0 ||
        (getmaxy(stdscr) == size.ws_row && getmaxx(stdscr) == size.ws_col))
        return false;
    (void)resizeterm(size.ws_row, size.ws_col);
    (void)clearok(curscr, TRUE);
    return true;
}

int top_screen_key(int wait_ms)
{
    if (follow_size())
        return TOP_KEY_RESIZE;
    timeout(wait_ms);
    errno = 0;
    const int key = getch();
    switch (key) {
    case ERR: return isatty(STDIN_FILENO) ? TOP_KEY_NONE : TOP_KEY_END;
    case KEY_UP: return TOP_KEY_UP;
    case KEY_DOWN: return TOP_KEY_DOWN;
    case KEY_RESIZE:
        (void)clearok(curscr, TRUE); /* the terminal may have moved what it shows */
        return TOP_KEY_RESIZE;
    case '\n':
    case '\r':
    case KEY_ENTER: return TOP_KEY_ENTER;
    case KEY_BACKSPACE:
    case ERASE:
    case DELETE: return TOP_KEY_ERASE;
    case ESCAPE: return TOP_KEY_ESCAPE;
    default: return key > 0 && key < 256 ? key : TOP_KEY_NONE;
    }
}
