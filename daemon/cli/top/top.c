/* SPDX-License-Identifier: MIT
 *
 * top.c - canwire top: buses, nodes and fault rules, live on a terminal.
 *
 * It asks the control socket at each interval. The teller of the client gets all messages, since
 * standard error would destroy the screen.
 */
#include "base/text/jsonput.h"
#include "base/text/number.h"
#include "base/text/plain.h"
#include "base/wall.h"
#include "cli/buses.h"
#include "cli/cli.h"
#include "cli/command.h"
#include "cli/top/top_bus.h"
#include "cli/top/top_layout.h"
#include "cli/top/top_screen.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define PATIENCE_S 2 /* for a bus that hangs */
#define MESSAGE_MAX 512
#define INPUT_MAX 2000
#define ROWS_MAX 500u
#define PLAIN_COLUMNS 80u
#define INTERVAL_MIN_NS UINT64_C(100000000)
#define INTERVAL_MAX_NS UINT64_C(60000000000)
#define NS_PER_MS 1000000u

static const char help[] =
    "Shows buses, and nodes and fault rules of one of them, until you press q: load, states,\n"
    "error counters, rates and worst delays. Without BUS it shows all buses in /run/canwire. Keys\n"
    "inject and clear rules, restart nodes, and stop the screen; ? lists them. Rates are those of\n"
    "the last interval, in bus time; worst delays, from hand-in to the end of the frame, are\n"
    "since the start.\n"
    "\n"
    "      --interval T   between two looks, 100ms to 60s; default 1s\n"
    "      --once         prints one interval as plain text, and ends\n";

typedef struct top {
    top_bus *buses;
    top_shown shown[TOP_BUSES_MAX];
    unsigned count;
    unsigned bus;
    unsigned selected;
    bool paused;
    bool help;
    bool once;
    bool asks; /* for a rule */
    bool failing;
    uint64_t interval_ns;
    char message[MESSAGE_MAX];
    char input[INPUT_MAX];
    size_t input_length;
} top;

static volatile sig_atomic_t interrupted;
static char told[MESSAGE_MAX];

static void top_on_signal(int number)
{
    interrupted = number;
}

static void top_tell(const char *text)
{
    (void)snprintf(told, sizeof told, "%s", text);
    plain_make(told, '?');
}

/* ---- Numbers --------------------------------------------------------------------------------- */

static const top_model *model(const top *t)
{
    return &t->buses[t->bus].model;
}

/* Asks all buses. One that does not answer keeps its last numbers, and a message stays until all
 * answer again. */
static void ask_all(top *t)
{
    bool good = true;
    for (unsigned i = 0; i < t->count; i++) {
        t->shown[i].there = top_bus_ask(&t->buses[i]);
        good = good && t->shown[i].there;
    }
    if (!good)
        (void)snprintf(t->message, sizeof t->message, "%s", told);
    else if (t->failing)
        *t->message = '\0';
    t->failing = !good;
    const unsigned rows = model(t)->node_count + model(t)->rule_count;
    if (t->selected != TOP_NONE && t->selected >= rows)
        t->selected = rows > 0 ? rows - 1 : TOP_NONE;
}

/* ---- Screen ---------------------------------------------------------------------------------- */

static top_line lines[ROWS_MAX];

/* Returns the last line: what is typed, of which the end is seen, a message, or NULL. */
static const char *last_line(const top *t, unsigned columns)
{
    static char line[INPUT_MAX + 16];
    if (!t->asks)
        return *t->message ? t->message : NULL;
    const size_t room = columns > 10 ? columns - 10 : 0;
    const size_t hidden = t->input_length > room ? t->input_length - room : 0;
    (void)snprintf(line, sizeof line, "inject: %s_", t->input + hidden);
    return line;
}

/* Returns all that the layout needs to know: it has no other state. */
static top_view view_of(const top *t, unsigned columns)
{
    return (top_view){.buses = t->shown,
                      .bus_count = t->count,
                      .bus = t->bus,
                      .selected = t->selected,
                      .paused = t->paused,
                      .help = t->help,
                      .message = last_line(t, columns)};
}

/* Draws anew for the size that the terminal has now. */
static void top_show(const top *t)
{
    unsigned rows, columns;
    top_screen_size(&rows, &columns);
    const top_view view = view_of(t, columns);
    top_screen_show(lines, top_layout(lines, rows < ROWS_MAX ? rows : ROWS_MAX, columns, &view));
}

/* ---- Keys ------------------------------------------------------------------------------------ */

/* Sends a request to the bus that is shown, and tells the outcome. */
static void act(top *t, json_t *request, const char *done, const char *what)
{
    if (top_bus_send(&t->buses[t->bus], request))
        (void)snprintf(t->message, sizeof t->message, "%s%s", done, what);
    else
        (void)snprintf(t->message, sizeof t->message, "%s", told);
}

/* Restarts the selected node, which must be one and no rule. */
static void restart(top *t)
{
    const top_model *m = model(t);
    if (t->selected >= m->node_count) {
        (void)snprintf(t->message, sizeof t->message, "select a node first, with Up and Down");
        return;
    }
    json_t *request = client_request("restart");
    put_text(request, "node", m->nodes[t->selected].name);
    act(t, request, "restarting ", m->nodes[t->selected].name);
}

/* Clears the selected rule. In the list, rules come after nodes. */
static void top_clear(top *t)
{
    const top_model *m = model(t);
    if (t->selected == TOP_NONE || t->selected < m->node_count) {
        (void)snprintf(t->message, sizeof t->message, "select a rule first, with Up and Down");
        return;
    }
    const top_rule *rule = &m->rules[t->selected - m->node_count];
    json_t *request = client_request("clear");
    put_text(request, "rule", rule->name);
    act(t, request, "cleared ", rule->name);
}

static void clear_injected(top *t)
{
    json_t *request = client_request("clear");
    put_bool(request, "injected", true);
    act(t, request, "cleared what was injected", "");
}

static void inject(top *t)
{
    json_t *request = client_request("inject");
    put(request, "text", text_to_json(t->input, t->input_length));
    act(t, request, "injected", "");
}

static void begin_input(top *t)
{
    t->asks = true;
    t->input_length = 0;
    *t->input = '\0';
}

/* Takes a key while a rule is typed in: Enter injects it, Escape gives it up. */
static void take_input(top *t, int key)
{
    if (key == TOP_KEY_ENTER || key == TOP_KEY_ESCAPE)
        t->asks = false;
    if (key == TOP_KEY_ENTER && t->input_length > 0)
        inject(t);
    if (key == TOP_KEY_ERASE && t->input_length > 0)
        t->input[--t->input_length] = '\0';
    if (key >= ' ' && key < 127 && t->input_length + 1 < sizeof t->input) {
        t->input[t->input_length++] = (char)key;
        t->input[t->input_length] = '\0';
    }
}

/* Shows another bus. The selection belongs to a bus, so it is dropped. A number without a bus does
 * nothing. */
static void select_bus(top *t, unsigned bus)
{
    if (bus >= t->count)
        return;
    t->bus = bus;
    t->selected = TOP_NONE;
}

/* Moves the selection over nodes and rules, which are one list. The first key selects an end of
 * it. */
static void top_move(top *t, int by)
{
    const unsigned rows = model(t)->node_count + model(t)->rule_count;
    if (rows == 0)
        return;
    if (t->selected == TOP_NONE)
        t->selected = by > 0 ? 0 : rows - 1;
    else if (by > 0 ? t->selected + 1 < rows : t->selected > 0)
        t->selected += by > 0 ? 1u : -1u;
}

/* Returns false to end. */
static bool take_key(top *t, int key)
{
    if (t->asks) {
        take_input(t, key);
        return key != TOP_KEY_END;
    }
    if (key != TOP_KEY_NONE && key != TOP_KEY_RESIZE && !t->failing)
        *t->message = '\0';
    switch (key) {
    case TOP_KEY_END:
    case 'q': return false;
    case ' ':
    case 'p': t->paused = !t->paused; break;
    case '?':
    case 'h': t->help = !t->help; break;
    case TOP_KEY_ESCAPE: t->help = false; break;
    case TOP_KEY_UP:
    case 'k':
        top_move(t, -1);
        break;
    case TOP_KEY_DOWN:
    case 'j':
        top_move(t, 1);
        break;
    case '\t': select_bus(t, (t->bus + 1) % t->count); break;
    case 'i': begin_input(t); break;
    case 'c':
        top_clear(t);
        break;
    case 'C': clear_injected(t); break;
    case 'r': restart(t); break;
    default:
        if (key >= '1' && key <= '9')
            select_bus(t, (unsigned)(key - '1'));
    }
    return true;
}

/* ---- Running --------------------------------------------------------------------------------- */

static uint64_t now_ns(void)
{
    return (uint64_t)wall_ns();
}

/* Catches what ends programs, so that the terminal is as before at the end. */
static void catch_signals(void)
{
    const struct sigaction action = {.sa_handler = top_on_signal};
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
    (void)sigaction(SIGHUP, &action, NULL);
}

/* Shows the buses until the user ends it. A key is answered at once; buses are asked in their
 * interval. */
static void run_screen(top *t)
{
    uint64_t next = now_ns() + t->interval_ns;
    bool goes_on = true;
    while (goes_on && !interrupted) {
        top_show(t);
        const uint64_t now = now_ns();
        const int wait_ms = now < next ? (int)((next - now) / NS_PER_MS) + 1 : 0;
        goes_on = take_key(t, top_screen_key(wait_ms));
        if (now_ns() < next)
            continue;
        if (!t->paused)
            ask_all(t);
        next = now_ns() + t->interval_ns;
    }
}

/* Runs the screen, and puts the terminal back at the end, also after a signal. Returns the exit
 * status. */
static int top_run(top *t)
{
    if (!isatty(STDOUT_FILENO) || !isatty(STDIN_FILENO)) {
        fputs("canwire top: this is no terminal: use --once\n", stderr);
        return CLI_BAD_INPUT;
    }
    client_set_teller(top_tell);
    catch_signals();
    const char *why = top_screen_begin();
    if (why) {
        plain_print(stderr, "canwire top: %s\n", why);
        return CLI_BAD_INPUT;
    }
    run_screen(t);
    top_screen_end();
    return CLI_OK;
}

/* Returns the width of plain text: COLUMNS, when it is set, else 80. */
static unsigned plain_columns(void)
{
    const char *text = getenv("COLUMNS");
    uint64_t columns = 0;
    if (!text || text_parse_uint(&columns, text) || columns < TOP_COLUMNS_MIN)
        return PLAIN_COLUMNS;
    return columns < TOP_COLUMNS_MAX ? (unsigned)columns : TOP_COLUMNS_MAX;
}

/* Prints the buses, and nodes and rules of each. */
static int print_once(top *t)
{
    const struct timespec interval = {.tv_sec = (time_t)(t->interval_ns / 1000000000u),
                                      .tv_nsec = (long)(t->interval_ns % 1000000000u)};
    (void)nanosleep(&interval, NULL);
    for (unsigned i = 0; i < t->count; i++) {
        t->shown[i].there = top_bus_ask(&t->buses[i]);
        if (!t->shown[i].there)
            return CLI_BAD_INPUT;
    }
    const unsigned columns = plain_columns();
    for (t->bus = 0; t->bus < t->count; t->bus++) {
        const top_view view = view_of(t, columns);
        const unsigned rows = top_layout_rows(&view);
        top_line *all = calloc(rows + TOP_ROWS_MIN, sizeof *all);
        if (!all)
            return CLI_BAD_INPUT;
        (void)top_layout(all, rows + TOP_ROWS_MIN, columns, &view);
        for (unsigned i = t->bus > 0 ? 1 + t->count : 0; i < rows; i++)
            puts(all[i].text);
        free(all);
    }
    return CLI_OK;
}

/* Times in bits are refused, as buses have several bit rates. */
static bool take_interval(void *out, const char *option, const char *text)
{
    top *t = out;
    cfg_time time = {.ns = 0};
    const char *wrong = text_parse_time(&time, text);
    if (!wrong && (time.bits > 0 || time.ns < INTERVAL_MIN_NS || time.ns > INTERVAL_MAX_NS))
        wrong = "expected a time from 100ms to 60s";
    t->interval_ns = time.ns;
    if (wrong)
        plain_print(stderr, "canwire top: %s %s: %s\n", option, text, wrong);
    return !wrong;
}

/* Begins the named buses, all of which must run. Later the screen waits for none. */
static bool top_begin(top *t, char **names, unsigned count)
{
    t->buses = calloc(count, sizeof *t->buses);
    for (unsigned i = 0; t->buses && i < count; i++) {
        top_bus_begin(&t->buses[i], names[i]);
        t->count++;
        t->shown[i] = (top_shown){.model = &t->buses[i].model, .there = true};
        if (!top_bus_ask(&t->buses[i]))
            return false;
    }
    client_set_wait(0);
    return t->buses != NULL;
}

/* Shows these buses, of which at least one must be there. */
static int run_with(top *t, char **names, size_t count)
{
    int status = CLI_BAD_INPUT;
    if (count == 0 && buses_error() != 0)
        plain_print(stderr, "canwire top: %s: %s\n", buses_folder(), strerror(buses_error()));
    else if (count == 0)
        plain_print(stderr, "canwire top: no bus runs in %s\n", buses_folder());
    else if (count > TOP_BUSES_MAX)
        plain_print(stderr, "canwire top: up to %u buses\n", TOP_BUSES_MAX);
    else if (top_begin(t, names, (unsigned)count))
        status = t->once ? print_once(t) : top_run(t);
    for (unsigned i = 0; i < t->count; i++)
        top_bus_end(&t->buses[i]);
    free(t->buses);
    return status;
}

int cli_top(int argc, char **argv)
{
    int first = 0;
    top t = {.interval_ns = 1000000000u, .selected = TOP_NONE};
    const command c = {.usage = "canwire top [BUS...] [--interval T] [--once]",
                       .help = help,
                       .words_max = -1,
                       .options = {{"interval", .read = take_interval, .out = &t},
                                   {"once", .flag = &t.once}}};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    client_set_patience(PATIENCE_S);
    if (first < argc)
        return run_with(&t, argv + first, (size_t)(argc - first));
    char *found[TOP_BUSES_MAX];
    size_t count = buses_find(found, TOP_BUSES_MAX, false);
    if (count == 0) /* then each says that it is closed */
        count = buses_find(found, TOP_BUSES_MAX, true);
    status = run_with(&t, found, count);
    for (size_t i = 0; i < count; i++)
        free(found[i]);
    return status;
}
