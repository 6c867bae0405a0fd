/* SPDX-License-Identifier: MIT
 *
 * restart.c - canwire restart: restarts a node that is bus-off.
 */
#include "base/text/jsonput.h"
#include "cli/client.h"
#include "cli/command.h"

static const char help[] =
    "Restarts a node that is bus-off, as `ip link set DEVICE type can restart` does. It comes "
    "back\n"
    "after 128 groups of 11 recessive bits. Frames that its program writes meanwhile wait.\n"
    "Refused for nodes with restart-ms: they come by themselves.\n"
    "\n";

int cli_restart(int argc, char **argv)
{
    int first = 0;
    const command c = {
        .usage = "canwire restart BUS NODE", .help = help, .words_min = 2, .words_max = 2};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    json_t *request = client_request("restart");
    put_text(request, "node", argv[first + 1]);
    return client_report(argv[first], request);
}
