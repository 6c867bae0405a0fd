/* SPDX-License-Identifier: MIT
 *
 * clear.c - canwire clear and canwire fire: ends a fault rule, or lets a manual one act.
 */
#include "base/text/counted.h"
#include "base/text/jsonput.h"
#include "cli/client.h"
#include "cli/command.h"

static const char clear_help[] =
    "Ends what a fault rule does and takes it away; without RULE all rules, configured ones too,\n"
    "and says how many there were.\n"
    "\n"
    "      --injected   without RULE: only rules that were injected\n";

static const char fire_help[] =
    "Lets a rule with `manual: yes` act once, as if its `after` had hit.\n\n";

/* Clears rules and prints their number. */
static int clear_many(const char *bus, json_t *request)
{
    json_t *reply = client_ask_once(bus, request);
    const size_t count = json_array_size(json_object_get(reply, "rules"));
    if (!reply)
        return CLI_BAD_INPUT;
    json_decref(reply);
    printf("%s cleared\n", counted(count, "rule").text);
    return CLI_OK;
}

int cli_clear(int argc, char **argv)
{
    bool injected = false;
    int first = 0;
    const command c = {.usage = "canwire clear BUS [RULE] [--injected]",
                       .help = clear_help,
                       .words_min = 1,
                       .words_max = 2,
                       .options = {{"injected", .flag = &injected}}};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    json_t *request = client_request("clear");
    if (first + 1 < argc)
        put_text(request, "rule", argv[first + 1]);
    if (injected)
        put_bool(request, "injected", true);
    return first + 1 < argc ? client_report(argv[first], request)
                            : clear_many(argv[first], request);
}

int cli_fire(int argc, char **argv)
{
    int first = 0;
    const command c = {
        .usage = "canwire fire BUS RULE", .help = fire_help, .words_min = 2, .words_max = 2};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    json_t *request = client_request("fire");
    put_text(request, "rule", argv[first + 1]);
    return client_report(argv[first], request);
}
