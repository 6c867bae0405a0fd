/* SPDX-License-Identifier: MIT
 *
 * watch.c - canwire watch: prints the events of a bus as they happen.
 */
#include "base/text/jsonput.h"
#include "base/text/plain.h"
#include "cli/client.h"
#include "cli/command.h"

#include <string.h>
#include <unistd.h>

static const char help[] =
    "Shows what happens on a bus until it ends or you press Ctrl-C: a line per event and node, "
    "from\n"
    "now on; a table on a terminal, else lines of JSON. When this reads too slowly, the bus does "
    "not\n"
    "wait; how many events were lost is told. Synchronisations of clocks come only when `sync` is\n"
    "named.\n"
    "\n"
    "  KIND         only events of these kinds: fault, link, drop, restart, arbitration-lost,\n"
    "               improper-arbitration, error, overload, protocol-exception, overrun, rx, tx,\n"
    "               wake, state, skip, record, sync, capture\n"
    "      --json   lines of JSON, as the bus sends them, on a terminal, too\n"
    "      --text   the table, not only on a terminal\n";

/* The columns at the beginning of a line of text. */
#define NODE_WIDTH 16
#define KIND_WIDTH 16

/* Prints a member of an event. Of one that is true the name says all. */
static void print_value(const char *key, const json_t *value)
{
    if (json_is_string(value))
        printf(" %s %s", key, json_string_value(value));
    else if (json_is_true(value))
        printf(" %s", key);
    else
        printf(" %s %" JSON_INTEGER_FORMAT, key, json_integer_value(value));
}

static bool is_column(const char *key)
{
    return strcmp(key, "t") == 0 || strcmp(key, "node") == 0 || strcmp(key, "event") == 0;
}

/* Prints time, node and kind in columns, then the other members by name; a frame has no name. */
static void print_event(json_t *event)
{
    const char *node = get_text(event, "node");
    const char *kind = get_text(event, "event");
    const char *frame = get_text(event, "frame");
    printf("%15.9f  %-*s %-*s", json_real_value(json_object_get(event, "t")), NODE_WIDTH,
           node ? node : "-", frame || json_object_size(event) > 3 ? KIND_WIDTH : 0,
           kind ? kind : "?");
    if (frame)
        printf(" %s", frame);
    for (void *i = json_object_iter(event); i; i = json_object_iter_next(event, i)) {
        const char *key = json_object_iter_key(i);
        if (!is_column(key) && strcmp(key, "frame") != 0)
            print_value(key, json_object_iter_value(i));
    }
    putchar('\n');
}

/* Prints an event for people. A line that is not an event gets a message. */
static void watch_print_line(const char *line)
{
    json_error_t error;
    json_t *event = client_parse(line, &error);
    const json_t *lost = json_object_get(event, "lost");
    if (lost)
        printf("%15s  %" JSON_INTEGER_FORMAT " events lost, this reads too slowly\n", "",
               json_integer_value(lost));
    else if (json_is_object(event))
        print_event(event);
    else
        plain_print(stderr, "canwire watch: an event is left out: %s\n",
                    event ? "no object" : error.text);
    json_decref(event);
}

/* Prints events until the bus ends. That is an error: the bus was to be watched. */
static int show_events(client *c, bool json)
{
    const char *line;
    setvbuf(stdout, NULL, _IOLBF, 0);
    while (!ferror(stdout) && (line = client_next(c))) {
        if (json)
            puts(line);
        else
            watch_print_line(line);
    }
    if (!ferror(stdout))
        (void)client_report_end(c);
    return CLI_BAD_INPUT;
}

/* Makes a watch request for the named kinds; blanks or commas separate them. */
static json_t *make_request(char **words, int count)
{
    json_t *request = client_request("watch");
    json_t *kinds = json_array();
    for (int i = 0; i < count; i++) {
        char *rest = NULL;
        for (char *w = strtok_r(words[i], ",", &rest); w; w = strtok_r(NULL, ",", &rest))
            put_text_last(kinds, w);
    }
    if (count > 0)
        put(request, "events", kinds);
    else
        json_decref(kinds);
    return request;
}

int cli_watch(int argc, char **argv)
{
    bool json = false;
    bool text = false;
    int first = 0;
    client bus;
    const command c = {.usage = "canwire watch BUS [KIND...] [--json|--text]",
                       .help = help,
                       .words_min = 1,
                       .words_max = -1,
                       .options = {{"json", .flag = &json},
                                   {"text", .flag = &text}}};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    if (!client_open(&bus, argv[first]))
        return CLI_BAD_INPUT;
    json_t *reply = client_ask(&bus, make_request(argv + first + 1, argc - first - 1));
    bool lines = json || (!text && !isatty(STDOUT_FILENO));
    status = reply ? show_events(&bus, lines) : CLI_BAD_INPUT;
    json_decref(reply);
    client_close(&bus);
    return status;
}
