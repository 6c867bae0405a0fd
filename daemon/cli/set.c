/* SPDX-License-Identifier: MIT
 *
 * set.c - canwire set: changes settings of a node while the bus runs.
 */
#include "base/jsonput.h"
#include "base/plain.h"
#include "cli/client.h"
#include "cli/command.h"

#include <string.h>

static const char usage[] = "canwire set BUS NODE KEY=VALUE...";

static const char help[] =
    "Changes settings of a node at once; the configuration's file stays as it is. Keys are those "
    "of\n"
    "the configuration, as in `ip link set ... type can`:\n"
    "\n"
    "  loopback, listen-only, one-shot, berr-reporting, presume-ack, restricted,\n"
    "  time-triggered, lost-arbitration-reporting                     on or off\n"
    "  restart-ms       0 to 4294967295; 0: never by itself\n"
    "  queue            1 to 4096 frames\n"
    "  order            priority or fifo\n"
    "  warning-limit    1 to 255\n"
    "  sleep            on or off\n"
    "  wake-filter, wake-time\n"
    "                   0 to 1s, such as 5us: of the dominant phase that wakes the node, and from\n"
    "                   then until it integrates\n"
    "  wake-on          frames that wake it instead, such as 123,500:7F0; or off\n"
    "  ppm              -100000 to 100000, error of the clock in millionths\n"
    "  clock            100kHz to 1GHz\n"
    "  sample-point     10% to 99.9%; finds the segments, as in the configuration\n"
    "  brp, prop-seg, phase-seg1, phase-seg2, sjw                     as the controller allows\n"
    "  triple-sampling  on or off\n"
    "\n"
    "  dbrp, dprop-seg, dphase-seg1, dphase-seg2, dsjw, dsample-point\n"
    "                   the same of the data phase; only where the node has one (CAN FD)\n"
    "  tdc-mode         off, auto or manual\n"
    "  tdco, tdcv       0, or 1, to 65535 clocks; tdcv only with tdc-mode manual\n"
    "\n"
    "  tx-delay, rx-delay\n"
    "                   0 to 10ms, such as 120ns; or 120ns/180ns: of edges to dominant, and to\n"
    "                   recessive\n"
    "  position, stub   0 to 10km, such as 12m\n"
    "  ringing          0 to 10ms, at most 16 bits\n"
    "\n"
    "A bit timing changes from the node's next bit on. Delays and places change for the edges\n"
    "that come from now on: one that is under way arrives as it would have. A\n"
    "sample-point finds the data phase anew, too. when-full, controller, kind and all other keys\n"
    "change in the configuration, see `canwire reload`.\n"
    "\n";

/* Puts KEY=VALUE into an object. */
static bool put_setting(json_t *settings, char *word)
{
    char *equals = strchr(word, '=');
    if (!equals || equals == word) {
        plain_print(stderr, "canwire set: %s: expected KEY=VALUE\n", word);
        return false;
    }
    *equals = '\0';
    put_text(settings, word, equals + 1);
    *equals = '=';
    return true;
}

/* Returns true for a setting in the place of a node, as in NODE KEY=VALUE BUS. */
static bool is_swapped(const char *node)
{
    return strchr(node, '=') != NULL;
}

int cli_set(int argc, char **argv)
{
    int first = 0;
    const command c = {.usage = usage, .help = help, .words_min = 3, .words_max = -1};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    if (is_swapped(argv[first + 1])) {
        plain_print(stderr, "canwire set: the bus comes first, and that is %s\nusage: %s\n",
                    argv[argc - 1], usage);
        return CLI_USAGE;
    }
    json_t *settings = json_object();
    for (int i = first + 2; i < argc; i++) {
        if (!put_setting(settings, argv[i])) {
            json_decref(settings);
            return CLI_USAGE;
        }
    }
    json_t *request = client_request("set");
    put_text(request, "node", argv[first + 1]);
    put(request, "settings", settings);
    return client_report(argv[first], request);
}
