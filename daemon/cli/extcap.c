/* SPDX-License-Identifier: MIT
 *
 * extcap.c - canwire extcap: Wireshark asks it for buses and lets it capture one.
 *
 * Wireshark calls the programs in its extcap folder with options that are named --extcap-..., and
 * reads lines such as "interface {value=NAME}{display=TEXT}". For a capture it makes a fifo.
 */
#include "base/text/plain.h"
#include "base/version.h"
#include "cli/buses.h"
#include "cli/cli.h"
#include "cli/record_bus.h"

#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define PREFIX "canwire-" /* of an interface; the name of a bus follows */
#define LINKTYPE 227      /* LINKTYPE_CAN_SOCKETCAN */

static const char usage[] = "canwire extcap OPTION...";

static const char help[] =
    "Wireshark calls this to list the buses in /run/canwire by itself, as interfaces canwire-BUS,\n"
    "and to capture them. `make install` puts a program that does so into Wireshark's folder of\n"
    "such programs; see \"Wireshark lists the buses\" in canwire-record(7).\n"
    "\n"
    "      --extcap-interfaces          lists the buses that run\n"
    "      --extcap-interface I         that is meant by the following ones: canwire-BUS\n"
    "      --extcap-dlts                shows the type of its packets\n"
    "      --extcap-config              shows the options of a capture\n"
    "      --capture                    captures until the fifo has no reader\n"
    "      --fifo FILE                  that it captures into\n"
    "      --frames-only                without error frames\n"
    "      --extcap-capture-filter F    is refused: there are no capture filters\n"
    "      --extcap-version V           of Wireshark, is ignored\n"
    "  -h, --help                       this text\n"
    "\n"
    "Exit status: 0, 1 the bus cannot be captured, 2 wrong usage.\n";

typedef struct request {
    bool interfaces;
    bool dlts;
    bool config;
    bool capture;
    bool frames_only;
    const char *interface;
    const char *fifo;
    const char *filter;
} request;

/* ---- Answers --------------------------------------------------------------------------------- */

static int show_interfaces(void)
{
    char *names[BUSES_MAX];
    const size_t count = buses_find(names, BUSES_MAX, false);
    printf("extcap {version=%s}{display=canwire}\n", CANWIRE_VERSION);
    for (size_t i = 0; i < count; i++) {
        printf("interface {value=" PREFIX "%s}{display=CAN bus %s}\n", names[i], names[i]);
        free(names[i]);
    }
    return CLI_OK;
}

static int show_dlts(void)
{
    printf("dlt {number=%d}{name=CAN_SOCKETCAN}{display=SocketCAN}\n", LINKTYPE);
    return CLI_OK;
}

static int show_config(void)
{
    puts("arg {number=0}{call=--frames-only}{display=Frames only}"
         "{tooltip=Without the error frames of the nodes}{type=boolflag}{default=false}");
    return CLI_OK;
}

/* Wireshark shows what is printed about a filter as the reason why it is bad. */
static int check_filter(const char *filter)
{
    if (*filter)
        puts("canwire has no capture filters: use a display filter");
    return CLI_OK;
}

/* ---- Capture --------------------------------------------------------------------------------- */

static int extcap_refuse(const char *name, const char *why)
{
    plain_print(stderr, "canwire extcap: %s: %s\n", name, why);
    return CLI_BAD_INPUT;
}

static int capture(const request *r)
{
    static char name[] = "the fifo";
    record_order order = {.frames_only = r->frames_only, .quiet = true, .tool = "canwire extcap"};
    if (r->filter && *r->filter)
        return extcap_refuse(r->filter, "there are no capture filters: use a display filter");
    cfg_record_default(&order.what);
    order.what.format = CFG_RECORD_PCAPNG;
    order.what.file = name;
    order.stream = open(r->fifo, O_WRONLY | O_CLOEXEC);
    if (order.stream < 0)
        return extcap_refuse(r->fifo, strerror(errno));
    int status = record_bus(r->interface + strlen(PREFIX), &order);
    (void)close(order.stream);
    return status;
}

/* ---- Command line ---------------------------------------------------------------------------- */

enum {
    INTERFACES = 256,
    DLTS,
    CONFIG,
    CAPTURE,
    FRAMES_ONLY,
    INTERFACE,
    FIFO,
    FILTER,
    IGNORED,
};

static const struct option options[] = {
    {"extcap-interfaces", no_argument, NULL, INTERFACES},
    {"extcap-dlts", no_argument, NULL, DLTS},
    {"extcap-config", no_argument, NULL, CONFIG},
    {"capture", no_argument, NULL, CAPTURE},
    {"frames-only", no_argument, NULL, FRAMES_ONLY},
    {"extcap-interface", required_argument, NULL, INTERFACE},
    {"fifo", required_argument, NULL, FIFO},
    {"extcap-capture-filter", required_argument, NULL, FILTER},
    {"extcap-version", required_argument, NULL, IGNORED},
    {"help", no_argument, NULL, 'h'},
    {NULL, 0, NULL, 0},
};

static int wrong_usage(void)
{
    plain_print(stderr, "usage: %s\n", usage);
    return CLI_USAGE;
}

static void extcap_take_option(request *r, int option)
{
    switch (option) {
    case INTERFACES: r->interfaces = true; break;
    case DLTS: r->dlts = true; break;
    case CONFIG: r->config = true; break;
    case CAPTURE: r->capture = true; break;
    case FRAMES_ONLY: r->frames_only = true; break;
    case INTERFACE: r->interface = optarg; break;
    case FIFO: r->fifo = optarg; break;
    case FILTER: r->filter = optarg; break;
    default: break;
    }
}

static int extcap_answer(const request *r)
{
    if (r->interfaces)
        return show_interfaces();
    if (!r->interface)
        return wrong_usage();
    if (strncmp(r->interface, PREFIX, strlen(PREFIX)) != 0 || !r->interface[strlen(PREFIX)])
        return extcap_refuse(r->interface, "no such interface: they are named " PREFIX "BUS");
    if (r->dlts)
        return show_dlts();
    if (r->config)
        return show_config();
    if (r->capture && r->fifo)
        return capture(r);
    return r->filter && !r->capture ? check_filter(r->filter) : wrong_usage();
}

int cli_extcap(int argc, char **argv)
{
    request r = {.interfaces = false};
    int option;
    optind = 0;
    while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
        if (option == 'h') {
            printf("usage: %s\n\n%s", usage, help);
            return CLI_OK;
        }
        if (option == '?')
            return wrong_usage();
        extcap_take_option(&r, option);
    }
    return optind == argc ? extcap_answer(&r) : wrong_usage();
}
