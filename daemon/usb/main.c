/* SPDX-License-Identifier: MIT
 *
 * main.c - canwire-usb: the USB CAN adapters of the nodes with `port: { usb: … }`.
 */
#include "base/log.h"
#include "base/plain.h"
#include "base/standardfds.h"
#include "config/config.h"
#include "config/rig.h"
#include "usb/adapters.h"
#include "usb/privileges.h"

#include <errno.h>
#include <getopt.h>
#include <pwd.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <systemd/sd-daemon.h>
#include <time.h>

#define EXIT_USAGE 2
#define NS_PER_MS 1000000L

static const char usage[] = "usage: canwire-usb [--user USER] FILE\n";

static const char help[] =
    "\n"
    "Makes a real CAN interface for each node of the configuration FILE, or of the rig FILE, that "
    "has\n"
    "\"port: { usb: INTERFACE }\". It runs in the foreground, beside canwired, until SIGTERM or\n"
    "SIGINT; then the interfaces go. SIGHUP reads FILE again.\n"
    "\n"
    "      --user USER   who it runs as after the start; default canwire, else nobody\n"
    "  -h, --help        this text\n"
    "      --version     the version\n"
    "\n"
    "An interface belongs to an emulated PEAK PCAN-USB FD, and to the driver of Linux for it.\n"
    "Needs root to start, and the modules vhci-hcd and peak_usb. It keeps CAP_NET_ADMIN, to name\n"
    "the interfaces; the processes that answer the kernel keep nothing.\n"
    "\n"
    "Exit status: 0, 1 bad configuration or no vhci-hcd, 2 wrong usage.\n";

typedef struct settings {
    const char *user;
    const char *file;
} settings;

static volatile sig_atomic_t stopping, reloading;

static void on_signal(int number)
{
    if (number == SIGHUP)
        reloading = 1;
    else
        stopping = 1;
}

/* ---- Options --------------------------------------------------------------------------------- */

static int fail_usage(void)
{
    fputs(usage, stderr);
    return EXIT_USAGE;
}

static const char *default_user(void)
{
    return getpwnam("canwire") ? "canwire" : "nobody";
}

/* Reads the command line. Returns -1 to go on, or the exit status. */
static int read_options(settings *out, int argc, char **argv)
{
    static const struct option options[] = {
        {"user", required_argument, NULL, 'u'},
        {"help", no_argument, NULL, 'h'},
        {"version", no_argument, NULL, 'v'},
        {NULL, 0, NULL, 0},
    };
    int option;
    plain_options(argc, argv);
    while ((option = getopt_long(argc, argv, "h", options, NULL)) != -1) {
        switch (option) {
        case 'u':
            out->user = optarg;
            break;
        case 'h':
            fputs(usage, stdout);
            fputs(help, stdout);
            return EXIT_SUCCESS;
        case 'v':
            puts("canwire-usb " CANWIRE_VERSION);
            return EXIT_SUCCESS;
        default:
            return fail_usage();
        }
    }
    if (argc - optind != 1)
        return fail_usage();
    out->file = argv[optind];
    return -1;
}

/* ---- Configurations -------------------------------------------------------------------------- */

/* Takes the nodes of a file. Returns false after writing the reasons; nothing has changed then. */
static bool read_file(adapters *a, const char *file)
{
    rig *several;
    cfg *one;
    const bool good = rig_load_either(&several, &one, &(cfg_file){.name = file}, stderr);
    if (several)
        adapters_set(a, (const cfg *const *)several->buses, several->bus_count);
    else if (one)
        adapters_set(a, (const cfg *const *)&one, 1);
    rig_free(several);
    cfg_free(one);
    return good;
}

/* ---- The run --------------------------------------------------------------------------------- */

static void catch_signals(void)
{
    const struct sigaction caught = {.sa_handler = on_signal};
    const struct sigaction ignored = {.sa_handler = SIG_IGN};
    (void)sigaction(SIGTERM, &caught, NULL);
    (void)sigaction(SIGINT, &caught, NULL);
    (void)sigaction(SIGHUP, &caught, NULL);
    (void)sigaction(SIGPIPE, &ignored, NULL);
}

static void run(adapters *a, const char *file)
{
    const struct timespec pause = {.tv_nsec = ADAPTERS_TICK_MS * NS_PER_MS};
    bool told = false;
    while (!stopping) {
        if (reloading) {
            reloading = 0;
            if (!read_file(a, file))
                log_error("%s: not reloaded, all stays as it was", file);
        }
        adapters_tick(a);
        if (!told && adapters_are_ready(a)) {
            told = true;
            (void)sd_notify(0, "READY=1");
        }
        (void)nanosleep(&pause, NULL);
    }
    (void)sd_notify(0, "STOPPING=1");
}

static bool open_vhci(vhci *files)
{
    if (vhci_open(files))
        return true;
    const char *remedy = errno == ENOENT   ? " (modprobe vhci-hcd peak_usb)"
                         : errno == EACCES ? " (run it as root)"
                                           : "";
    log_error("the virtual USB host controller: %s%s", strerror(errno), remedy);
    return false;
}

int main(int argc, char **argv)
{
    vhci files;
    standardfds_hold();
    log_set_program("canwire-usb");
    settings s = {.user = default_user()};
    const int status = read_options(&s, argc, argv);
    if (status >= 0)
        return status;
    if (!open_vhci(&files))
        return EXIT_FAILURE;
    if (!privileges_become(s.user)) {
        log_error("user %s: %s", s.user, errno == ENOENT ? "no such user" : strerror(errno));
        return EXIT_FAILURE;
    }
    catch_signals();
    adapters *a = adapters_new(&files);
    const bool good = a && read_file(a, s.file);
    if (good)
        run(a, s.file);
    adapters_free(a);
    return good ? EXIT_SUCCESS : EXIT_FAILURE;
}
