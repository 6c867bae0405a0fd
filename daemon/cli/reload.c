/* SPDX-License-Identifier: MIT
 *
 * reload.c - canwire reload: a bus goes over to what its configuration says now.
 */
#include "client.h"
#include "command.h"

static const char help[] =
    "Lets canwired read its configuration again. When it is bad, nothing changes, and its errors "
    "are\n"
    "told as FILE:LINE:COLUMN: message. Nodes that do not change keep their state and queues.\n"
    "\n";

int cli_reload(int argc, char **argv)
{
    int first = 0;
    const command c = {.usage = "canwire reload BUS", .help = help, .words_min = 1, .words_max = 1};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    return client_tell(argv[first], client_request("reload"));
}
