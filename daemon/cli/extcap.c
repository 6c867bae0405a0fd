/* SPDX-License-Identifier: MIT
 *
 * extcap.c - canwire extcap: Wireshark asks it for buses and lets it capture one.
 *
 * Wireshark calls the programs in its extcap folder with options that are named --extcap-..., and
 * reads lines such as "interface {value=NAME}{display=TEXT}". For a capture it makes a fifo.
 */
#include "base/options.h"
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

static const char usage[] = "usage: canwire extcap OPTION...\n";

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

/* Lists the buses that run as interfaces, in the words of Wireshark. */
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

/* Records a bus into the fifo that Wireshark reads, until it closes that. */
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

#define EXTCAP_UNCLEAR (-1) /* the options do not say what to do */

/* Answers one of Wireshark's questions. That for the interfaces goes before all others. */
static int extcap_answer(const request *r)
{
    if (r->interfaces)
        return show_interfaces();
    if (!r->interface)
        return EXTCAP_UNCLEAR;
    if (strncmp(r->interface, PREFIX, strlen(PREFIX)) != 0 || !r->interface[strlen(PREFIX)])
        return extcap_refuse(r->interface, "no such interface: they are named " PREFIX "BUS");
    if (r->dlts)
        return show_dlts();
    if (r->config)
        return show_config();
    if (r->capture && r->fifo)
        return capture(r);
    return r->filter && !r->capture ? check_filter(r->filter) : EXTCAP_UNCLEAR;
}

int cli_extcap(int argc, char **argv)
{
    request r = {.interfaces = false};
    const char *ignored;
    const option_row rows[] = {
        {"extcap-interfaces", .flag = &r.interfaces},
        {"extcap-dlts", .flag = &r.dlts},
        {"extcap-config", .flag = &r.config},
        {"capture", .flag = &r.capture},
        {"frames-only", .flag = &r.frames_only},
        {"extcap-interface", .text = &r.interface},
        {"fifo", .text = &r.fifo},
        {"extcap-capture-filter", .text = &r.filter},
        {"extcap-version", .text = &ignored},
        {.name = NULL},
    };
    const option_table table = {.usage = usage, .help = help, .rows = rows};
    int status = options_read(&table, argc, argv);
    if (status < 0)
        status = optind == argc ? extcap_answer(&r) : EXTCAP_UNCLEAR;
    return status == EXTCAP_UNCLEAR ? options_refuse(&table) : status;
}
