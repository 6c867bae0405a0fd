/* SPDX-License-Identifier: MIT
 *
 * status.c - canwire status: a bus and its nodes, or all buses.
 */
#include "base/text/jsonput.h"
#include "base/text/plain.h"
#include "cli/buses.h"
#include "cli/client.h"
#include "cli/command.h"
#include "cli/status/status_check.h"
#include "serve/status.h"

#include <errno.h>
#include <glob.h>
#include <string.h>

#define SUFFIX ".sock"
#define PATTERN_MAX 4096
#define WHY_BYTES 512

static const char help[] = "Shows per node what `ip -details -statistics link show` shows for a "
                           "CAN device, and more: its\n"
                           "queue, overload frames, retransmissions, bus errors by type, dropped "
                           "frames by reason. The\n"
                           "bit timing is that of the moment, with the error of the clock (ppm) if "
                           "there is one. Without\n"
                           "BUS: all buses that run.\n"
                           "\n"
                           "      --json        as JSON; without BUS as a list\n"
                           "      --check       one line for monitoring, with the exit status of "
                           "Nagios: 0 OK,\n"
                           "                    1 WARNING, 2 CRITICAL (also a bus that does not "
                           "run or not\n"
                           "                    answer within 10 s), 3 UNKNOWN (an answer that is "
                           "not a status).\n"
                           "                    Without BUS a unit of systemd that has failed, "
                           "such as\n"
                           "                    canwired@BUS, is CRITICAL, too, also while it is "
                           "tried again\n"
                           "      --load W,C    limits of the load in percent; 0 or nothing is no\n"
                           "                    limit, which is the default\n"
                           "      --state W,C   limits of the state of nodes; default "
                           "error-passive,bus-off\n"
                           "      --sinks LEVEL  of LCM, a recording, the report of expectations "
                           "or a journal in\n"
                           "                    trouble, or a journal with a gap: ok, warning "
                           "(default) or critical\n"
                           "      --links LEVEL  of a node whose link is down or missing, or whose "
                           "TCP tunnel has no\n"
                           "                    peer, in the same way\n"
                           "      --losses LEVEL  of frames that were lost in the last 10 minutes, "
                           "since a queue was\n"
                           "                    full or a program too slow, and of bus time that "
                           "was skipped\n";

/* Takes a reply over. Returns its status, null when it has none, and NULL without a reply. */
static json_t *take_status(json_t *reply)
{
    json_t *status = json_object_get(reply, "status");
    status = reply && !status ? json_null() : json_incref(status);
    json_decref(reply);
    return status;
}

static json_t *ask(const char *bus)
{
    return take_status(client_ask_once(bus, client_request("status")));
}

/* Returns true for the status of a bus. Another one gets a message. */
static bool is_status(const json_t *status, const char *bus)
{
    if (status && !json_is_object(status))
        plain_print(stderr, "canwire: bus %s: what it answers has no status\n", bus);
    return json_is_object(status);
}

/* Returns the exit status. */
static int show_one(const char *bus, bool json)
{
    json_t *status = ask(bus);
    if (!is_status(status, bus)) {
        json_decref(status);
        return CLI_BAD_INPUT;
    }
    if (json)
        put_out(stdout, status);
    else
        status_print(stdout, status);
    json_decref(status);
    return CLI_OK;
}

static int folder_error; /* errno of the folder of buses */

/* Without a folder there is no bus. */
static int on_folder_error(const char *path, int error)
{
    (void)path;
    folder_error = error;
    return error != ENOENT;
}

/* Finds all sockets in the folder of buses. They may be left by a canwired that has been killed.
 * Returns false after printing why it does not know. */
static bool find_sockets(glob_t *found, char why[WHY_BYTES])
{
    char pattern[PATTERN_MAX];
    *found = (glob_t){.gl_pathc = 0};
    folder_error = ENOMEM;
    (void)snprintf(pattern, sizeof pattern, "%s/*" SUFFIX, buses_folder());
    const int result = glob(pattern, 0, on_folder_error, found);
    client_set_wait(0);
    if (result == 0 || result == GLOB_NOMATCH)
        return true;
    (void)snprintf(why, WHY_BYTES, "%s: %s%s", buses_folder(), strerror(folder_error),
                   folder_error == EACCES ? " (are you in the group canwire?)" : "");
    return false;
}

typedef struct answers {
    json_t *list;
    bool good; /* all have answered */
} answers;

/* Keeps the status of a bus. One bad answer makes the whole a failure, and the others are shown. */
static void take_answer(void *user, const char *path, json_t *reply)
{
    answers *all = user;
    json_t *status = take_status(reply);
    if (is_status(status, path)) {
        put_last(all->list, status);
        return;
    }
    all->good = false;
    json_decref(status);
}

/* An empty folder is reported only when it could be read: otherwise there is a message already. */
static void print_all(const json_t *list, bool good)
{
    for (size_t i = 0; i < json_array_size(list); i++) {
        if (i > 0)
            putchar('\n');
        status_print(stdout, json_array_get(list, i));
    }
    if (json_array_size(list) == 0 && good)
        plain_print(stderr, "canwire: no bus in %s\n", buses_folder());
}

/* Asks all buses at once: those that hang share one limit of time. Returns the exit status. */
static int show_all(bool json)
{
    glob_t found;
    char why[WHY_BYTES];
    answers all = {.list = json_array(), .good = true};
    if (!find_sockets(&found, why)) {
        json_decref(all.list);
        plain_print(stderr, "canwire: %s\n", why);
        return CLI_BAD_INPUT;
    }
    if (!client_ask_all(found.gl_pathv, found.gl_pathc, client_request("status"), take_answer,
                        &all))
        all.good = false;
    if (json)
        put_out(stdout, all.list);
    else
        print_all(all.list, all.good);
    globfree(&found);
    json_decref(all.list);
    return all.good ? CLI_OK : CLI_BAD_INPUT;
}

/* ---- For monitoring -------------------------------------------------------------------------- */

#define CHECK_PATIENCE_S 10

static char last_message[WHY_BYTES];

static void keep_message(const char *text)
{
    (void)snprintf(last_message, sizeof last_message, "%s",
                   strncmp(text, "canwire: ", 9) == 0 ? text + 9 : text);
}

typedef struct check_list {
    check *result;
    size_t count;
} check_list;

/* Judges the reply of a bus. Without one, the message that the client has left says why. */
static void check_answer(void *user, const char *path, json_t *reply)
{
    check_list *all = user;
    json_t *status = take_status(reply);
    check_bus(all->result, path, status, last_message);
    all->count++;
    json_decref(status);
}

/* Checks all buses that run. That none runs, or that nobody can tell, is a finding, too. Returns
 * true when none runs. */
static bool check_all(check *c)
{
    glob_t found;
    check_list all = {.result = c};
    bool known = find_sockets(&found, last_message);
    known = known && client_ask_all(found.gl_pathv, found.gl_pathc, client_request("status"),
                                    check_answer, &all);
    globfree(&found);
    if (all.count > 0)
        return false;
    if (known)
        (void)snprintf(last_message, sizeof last_message, "no bus runs in %s", buses_folder());
    check_bus(c, "", NULL, last_message);
    return known;
}

/* Checks as a plugin of a monitoring system, which reads one line: messages become part of it. */
static int show_check(const check_limits *limits, const char *bus)
{
    check c = {.limits = *limits};
    client_set_teller(keep_message);
    client_set_patience(CHECK_PATIENCE_S);
    if (!bus) {
        const bool none = check_all(&c);
        check_failed_units(&c, NULL, none);
        return check_end(&c);
    }
    json_t *status = ask(bus);
    check_bus(&c, bus, status, last_message);
    if (!json_is_object(status))
        check_failed_units(&c, bus, !status && !strchr(bus, '/') && !client_has_listener(bus));
    json_decref(status);
    return check_end(&c);
}

/* Returns true when monitoring has called: then wrong usage has another exit status. */
static bool wants_check(int argc, char **argv)
{
    for (int i = 1; i < argc; i++)
        if (strcmp(argv[i], "--check") == 0)
            return true;
    return false;
}

#define LIMIT(name, reader, into) {name, .read = reader, .out = into, .flag = &limits.given}

int cli_status(int argc, char **argv)
{
    bool json = false, checks = false;
    check_limits limits = CHECK_LIMITS_DEFAULT;
    const bool monitors = wants_check(argc, argv);
    int first = 0;
    const command c = {.usage = "canwire status [BUS] [--json | --check [--load W,C]\n"
                                "       [--state W,C] [--sinks LEVEL] [--links LEVEL]\n"
                                "       [--losses LEVEL]]",
                       .help = help,
                       .words_max = 1,
                       .options = {{"json", .flag = &json},
                                   {"check", .flag = &checks},
                                   LIMIT("load", check_take_load, &limits),
                                   LIMIT("state", check_take_state, &limits),
                                   LIMIT("sinks", check_take_level, &limits.sinks),
                                   LIMIT("links", check_take_level, &limits.links),
                                   LIMIT("losses", check_take_level, &limits.losses)}};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return monitors && status != CLI_OK ? (int)CHECK_UNKNOWN : status;
    if ((json && checks) || (limits.given && !checks)) {
        fputs("canwire status: limits go with --check, and neither with --json\n", stderr);
        return monitors ? (int)CHECK_UNKNOWN : CLI_USAGE;
    }
    client_allow_doubt();
    if (checks)
        return show_check(&limits, first < argc ? argv[first] : NULL);
    return first < argc ? show_one(argv[first], json) : show_all(json);
}
