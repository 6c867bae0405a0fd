/* SPDX-License-Identifier: MIT
 *
 * status.c - canwire status: a bus and its nodes, or all buses.
 */
#include "base/jsonput.h"
#include "base/plain.h"
#include "cli/client.h"
#include "cli/command.h"
#include "serve/status.h"

#include <glob.h>
#include <string.h>

#define SUFFIX ".sock"
#define PATTERN_MAX 4096

static const char help[] = "Shows per node what `ip -details -statistics link show` shows for a "
                           "CAN device, and more: its\n"
                           "queue, overload frames, retransmissions, bus errors by type, dropped "
                           "frames by reason. The\n"
                           "bit timing is that of the moment, with the error of the clock (ppm) if "
                           "there is one. Without\n"
                           "BUS: all buses that run.\n"
                           "\n"
                           "      --json   as JSON; without BUS as a list\n";

static json_t *ask(const char *bus)
{
    json_t *reply = client_ask_once(bus, client_request("status"));
    json_t *status = json_incref(json_object_get(reply, "status"));
    json_decref(reply);
    return status;
}

static int show_one(const char *bus, bool json)
{
    json_t *status = ask(bus);
    if (!status)
        return CLI_BAD_INPUT;
    if (json)
        put_out(stdout, status);
    else
        status_print(stdout, status);
    json_decref(status);
    return CLI_OK;
}

/* Asks all existing sockets; returns false when one did not answer. */
static bool ask_all(json_t *list, const glob_t *found)
{
    bool good = true;
    client_set_wait(0); /* what is there may be left by a canwired that has been killed */
    for (size_t i = 0; i < found->gl_pathc; i++) {
        json_t *status = ask(found->gl_pathv[i]);
        good = good && status;
        if (status)
            put_last(list, status);
    }
    return good;
}

static void print_all(const json_t *list)
{
    for (size_t i = 0; i < json_array_size(list); i++) {
        if (i > 0)
            putchar('\n');
        status_print(stdout, json_array_get(list, i));
    }
    if (json_array_size(list) == 0)
        plain_print(stderr, "canwire: no bus in %s\n", client_folder());
}

static int show_all(bool json)
{
    char pattern[PATTERN_MAX];
    glob_t found = {.gl_pathc = 0};
    json_t *list = json_array();
    (void)snprintf(pattern, sizeof pattern, "%s/*" SUFFIX, client_folder());
    bool good = glob(pattern, 0, NULL, &found) != 0 || ask_all(list, &found);
    if (json)
        put_out(stdout, list);
    else
        print_all(list);
    globfree(&found);
    json_decref(list);
    return good ? CLI_OK : CLI_BAD_INPUT;
}

int cli_status(int argc, char **argv)
{
    bool json = false;
    int first = 0;
    const command c = {.usage = "canwire status [BUS] [--json]",
                       .help = help,
                       .words_max = 1,
                       .options = {{.name = "json", .flag = &json}}};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    return first < argc ? show_one(argv[first], json) : show_all(json);
}
