/* SPDX-License-Identifier: MIT
 *
 * top_layout.c - the lines of canwire top: from numbers to text, for a screen of any size.
 *
 * From top to bottom: the buses, the nodes and the rules of one bus, and a line of keys or with a
 * message. It knows no terminal, so that tests can read what it makes.
 */
#include "cli/top/top_layout.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define BAR 7u /* characters of the bars of TEC and REC, with their brackets 9 */
#define LOAD_BAR 12u
#define NAME 10u
#define COUNTER_MAX 256 /* the TEC of bus-off */
#define WARNING 96
#define PASSIVE 128
#define NS_PER_US 1000
#define NS_PER_MS 1000000
#define CELL 24

static const char keys[] =
    "q quit  p pause  i inject  c clear  C clear injected  r restart  Tab bus  ? help";

static const char *const help_lines[] = {
    "  Up Down, k j   select a node or a rule",
    "  Tab, 1 to 9    show the next bus, or that one",
    "  i              inject a fault rule, which is YAML: asks for it",
    "  c              clear the selected rule, also one of the configuration",
    "  C              clear all rules that were injected",
    "  r              restart the selected node, which is bus-off",
    "  p, Space       pause: the screen stands still, the buses go on",
    "  q              quit",
    "  ?              this help, or back",
};

#define HELP_LINES (sizeof help_lines / sizeof help_lines[0])

typedef struct page {
    top_line *lines;
    unsigned rows;
    unsigned columns;
    unsigned used;
} page;

/* Adds a line as long as there are rows. It is cut at the width, and ends without blanks. */
static void __attribute__((format(printf, 3, 4)))
top_layout_add(page *p, top_style style, const char *format, ...)
{
    va_list args;
    if (p->used >= p->rows)
        return;
    top_line *line = &p->lines[p->used++];
    *line = (top_line){.style = style};
    va_start(args, format);
    (void)vsnprintf(line->text, p->columns + 1, format, args);
    va_end(args);
    for (size_t i = strlen(line->text); i > 0 && line->text[i - 1] == ' '; i--)
        line->text[i - 1] = '\0';
}

void top_bar(char *text, unsigned width, int64_t value, int64_t most)
{
    int64_t full = most > 0 ? (value * width + most - 1) / most : 0;
    full = full < 0 ? 0 : full;
    text[0] = '[';
    for (unsigned i = 0; i < width; i++)
        text[1 + i] = i < full ? '#' : ' ';
    text[1 + width] = ']';
    text[2 + width] = '\0';
}

/* ---- Cells ----------------------------------------------------------------------------------- */

/* Writes a rate of thousandths: one digit behind the point where it is small. */
static const char *rate(char text[CELL], int64_t milli)
{
    if (milli == 0)
        (void)snprintf(text, CELL, "0");
    else if (milli < 99950)
        (void)snprintf(text, CELL, "%" PRId64 ".%" PRId64, (milli + 50) / 1000,
                       (milli + 50) / 100 % 10);
    else
        (void)snprintf(text, CELL, "%" PRId64, (milli + 500) / 1000);
    return text;
}

/* Prints a time with a unit that leaves few digits; "-" for none. */
static const char *time_span(char text[CELL], int64_t ns)
{
    if (ns <= 0)
        (void)snprintf(text, CELL, "-");
    else if (ns < NS_PER_MS)
        (void)snprintf(text, CELL, "%" PRId64 " us", ns / NS_PER_US);
    else if (ns < INT64_C(1000) * NS_PER_MS)
        (void)snprintf(text, CELL, "%" PRId64 ".%" PRId64 " ms", ns / NS_PER_MS,
                       ns / (NS_PER_MS / 10) % 10);
    else
        (void)snprintf(text, CELL, "%" PRId64 ".%" PRId64 " s", ns / (INT64_C(1000) * NS_PER_MS),
                       ns / (INT64_C(100) * NS_PER_MS) % 10);
    return text;
}

/* Returns how bad the state of a node is, as its colour. */
static top_style style_of_node(const top_node *n)
{
    if (strcmp(n->state, "bus-off") == 0 || strncmp(n->state, "link ", 5) == 0)
        return TOP_DEAD;
    if (n->tec >= PASSIVE || n->rec >= PASSIVE)
        return TOP_SERIOUS;
    return n->tec >= WARNING || n->rec >= WARNING ? TOP_WARNING : TOP_PLAIN;
}

/* ---- Buses ----------------------------------------------------------------------------------- */

/* Returns how many nodes have a state of this colour. */
static unsigned count_state(const top_model *m, top_style style)
{
    unsigned found = 0;
    for (unsigned i = 0; i < m->node_count; i++)
        found += style_of_node(&m->nodes[i]) == style;
    return found;
}

/* Returns the longest delay of all nodes in ns; 0: no frame has been sent. */
static int64_t worst_delay(const top_model *m)
{
    int64_t worst = 0;
    for (unsigned i = 0; i < m->node_count; i++)
        if (m->nodes[i].delay_max_ns > worst)
            worst = m->nodes[i].delay_max_ns;
    return worst;
}

/* Adds the line of a bus. One that is gone is still shown: it may come back. */
static void add_bus(page *p, const top_view *v, unsigned number)
{
    const top_shown *bus = &v->buses[number];
    const top_model *m = bus->model;
    const char mark = number == v->bus && v->bus_count > 1 ? '>' : ' ';
    char bar[LOAD_BAR + 3], frames[CELL], errors[CELL], delay[CELL];
    if (!bus->there) {
        top_layout_add(p, TOP_DEAD, "%c%-15.15s %s", mark, m->name,
                       m->known ? "is gone, with these last numbers; asks again"
                                : "is not running; asks again");
        return;
    }
    top_bar(bar, LOAD_BAR, m->load_permille, 1000);
    const top_style style = count_state(m, TOP_DEAD) > 0 ? TOP_DEAD
                            : m->errors.rate > 0         ? TOP_WARNING
                                                         : TOP_PLAIN;
    top_layout_add(p, style, "%c%-15.15s %7" PRId64 " %3" PRId64 ".%" PRId64 " %s %8s %8s %10s",
                   mark, m->name, m->bitrate, m->load_permille / 10, m->load_permille % 10, bar,
                   rate(frames, m->frames.rate), rate(errors, m->errors.rate),
                   time_span(delay, worst_delay(m)));
}

/* The head also says that the screen is paused: old numbers must not pass for present ones. */
static void add_buses(page *p, const top_view *v)
{
    top_layout_add(p, TOP_HEAD, " %-15s %7s %5s %-14s %8s %8s %10s", "BUS", "BIT/S", "LOAD%",
                   v->paused ? "-- PAUSED --" : "", "FRAMES/S", "ERRORS/S", "WORST DLY");
    for (unsigned i = 0; i < v->bus_count; i++)
        add_bus(p, v, i);
}

/* ---- Nodes and rules ------------------------------------------------------------------------- */

/* Gives names of nodes what 80 columns leave, and what there is beyond. */
static int name_width(const page *p)
{
    const unsigned more = p->columns > 80 ? p->columns - 80 : 0;
    return (int)(NAME + (more < 20 ? more : 20));
}

/* Writes a name, of which a long one loses its middle: names often differ at their ends alone. */
static const char *fit(char text[TOP_NAME_MAX], const char *name, int width)
{
    const int length = (int)strlen(name), end = width / 2 - 1;
    if (length <= width)
        (void)snprintf(text, TOP_NAME_MAX, "%s", name);
    else
        (void)snprintf(text, TOP_NAME_MAX, "%.*s..%s", width - end - 2, name,
                       name + length - end);
    return text;
}

/* Adds the line of a node, with bars that show how near its counters are to bus-off. */
static void top_layout_add_node(page *p, const top_node *n)
{
    char name[TOP_NAME_MAX];
    char tec[BAR + 3], rec[BAR + 3], tx[CELL], rx[CELL], errors[CELL], delay[CELL];
    top_bar(tec, BAR, n->tec, COUNTER_MAX);
    top_bar(rec, BAR, n->rec, COUNTER_MAX);
    top_layout_add(p, style_of_node(n),
                   " %-*s %-13.13s %3" PRId64 " %s%4" PRId64 " %s %5s %5s %5s %8s", name_width(p),
                   fit(name, n->name, name_width(p)), n->state, n->tec, tec, n->rec, rec,
                   rate(tx, n->tx.rate), rate(rx, n->rx.rate), rate(errors, n->errors.rate),
                   time_span(delay, n->delay_max_ns));
}

static void add_node_head(page *p)
{
    top_layout_add(p, TOP_HEAD, " %-*s %-13s %-14s %-12s %5s %5s %5s %8s", name_width(p), "NODE",
                   "STATE", "TEC", "REC", "TX/S", "RX/S", "ERR/S", "WORST");
}

/* Adds the line of a rule. One that acts is marked. */
static void add_rule(page *p, const top_rule *t)
{
    char hits[CELL];
    const bool acts = strcmp(t->state, "active") == 0 || t->hits.rate > 0;
    top_layout_add(p, acts ? TOP_WARNING : TOP_PLAIN,
                   " %-24.24s %-12.12s %-8.8s %10" PRId64 " %7s  %s", t->name, t->action, t->state,
                   t->hits.value, rate(hits, t->hits.rate), t->injected ? "injected" : "file");
}

static void add_rule_head(page *p)
{
    top_layout_add(p, TOP_HEAD, " %-24s %-12s %-8s %10s %7s  %s", "RULE", "ACTION", "STATE", "HITS",
                   "HITS/S", "FROM");
}

/* Adds one of the lines below the buses: the heads, nodes and rules of a bus, from 0. */
static void add_row(page *p, const top_view *v, unsigned row)
{
    const top_model *m = v->buses[v->bus].model;
    const bool there = v->buses[v->bus].there;
    unsigned number = TOP_NONE;
    const unsigned before = p->used;
    if (row == 0) {
        add_node_head(p);
    } else if (row <= m->node_count) {
        number = row - 1;
        top_layout_add_node(p, &m->nodes[number]);
    } else if (row == m->node_count + 1) {
        add_rule_head(p);
    } else {
        number = row - 2;
        add_rule(p, &m->rules[number - m->node_count]);
    }
    if (p->used == before)
        return;
    p->lines[before].selected = number != TOP_NONE && number == v->selected;
    if (!there && number != TOP_NONE)
        p->lines[before].style = TOP_PLAIN;
}

static unsigned count_rows(const top_model *m)
{
    if (!m->known)
        return 0;
    return 1 + m->node_count + (m->rule_count > 0 ? 1 + m->rule_count : 0);
}

/* Returns the row of the selected node or rule. */
static unsigned selected_row(const top_view *v, const top_model *m)
{
    if (v->selected == TOP_NONE)
        return 0;
    return v->selected + (v->selected < m->node_count ? 1 : 2);
}

/* Adds a line between buses and rows, which says when some of these have no room. Then it adds rows
 * for which there is room: those up to the selected one, at least. */
static void add_rows(page *p, const top_view *v)
{
    const top_model *m = v->buses[v->bus].model;
    const unsigned rows = count_rows(m), selected = selected_row(v, m);
    const unsigned room = p->rows > p->used + 1 ? p->rows - p->used - 1 : 0;
    const unsigned first = selected >= room ? selected - room + 1 : 0;
    if (rows > room)
        top_layout_add(p, TOP_PLAIN, " lines %u to %u of %u: Up and Down show the others",
                       first + 1, first + room, rows);
    else
        top_layout_add(p, TOP_PLAIN, "%s", "");
    for (unsigned row = first; row < rows && row < first + room; row++)
        add_row(p, v, row);
}

/* ---- The page -------------------------------------------------------------------------------- */

unsigned top_layout_rows(const top_view *view)
{
    return 1 + view->bus_count + 1 + count_rows(view->buses[view->bus].model);
}

unsigned top_layout(top_line *lines, unsigned rows, unsigned columns, const top_view *view)
{
    const bool small = rows < TOP_ROWS_MIN || columns < TOP_COLUMNS_MIN;
    page p = {.lines = lines,
              .rows = rows,
              .columns = columns < TOP_COLUMNS_MAX ? columns : TOP_COLUMNS_MAX};
    if (small) {
        top_layout_add(&p, TOP_DEAD, "needs %u x %u", TOP_COLUMNS_MIN, TOP_ROWS_MIN);
        return p.used;
    }
    p.rows = rows - 1; /* the last line is of keys */
    if (view->help) {
        top_layout_add(&p, TOP_HEAD, "canwire top: keys");
        for (unsigned i = 0; i < HELP_LINES; i++)
            top_layout_add(&p, TOP_PLAIN, "%s", help_lines[i]);
    } else {
        add_buses(&p, view);
        add_rows(&p, view);
    }
    while (p.used < p.rows)
        top_layout_add(&p, TOP_PLAIN, "%s", "");
    p.rows = rows;
    top_layout_add(&p, TOP_HEAD, "%s", view->message ? view->message : keys);
    return p.used;
}
