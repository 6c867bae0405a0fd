/* SPDX-License-Identifier: MIT
 *
 * faults.c - canwire faults: the fault rules on a bus.
 */
#include "base/text/jsonput.h"
#include "cli/client.h"
#include "cli/command.h"
#include "serve/status.h"

static const char help[] =
    "Lists the fault rules on a bus, configured and injected, with how often they matched, hit "
    "and\n"
    "were passed over, and whether they act now (active), may act (waiting, manual) or are over.\n"
    "\n"
    "      --json   as JSON\n";

int cli_faults(int argc, char **argv)
{
    bool json = false;
    int first = 0;
    const command c = {.usage = "canwire faults BUS [--json]",
                       .help = help,
                       .words_min = 1,
                       .words_max = 1,
                       .options = {{"json", .flag = &json}}};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    json_t *reply = client_ask_once(argv[first], client_request("faults"));
    if (!reply)
        return CLI_BAD_INPUT;
    const json_t *faults = json_object_get(reply, "faults");
    if (json)
        put_out(stdout, faults);
    else
        status_print_faults(stdout, faults);
    json_decref(reply);
    return CLI_OK;
}
