/* SPDX-License-Identifier: MIT
 *
 * main.c - canwire-usb: the USB CAN adapters of the nodes with `port: { usb: … }`.
 */
#include "base/log.h"
#include "base/options.h"
#include "base/standardfds.h"
#include "base/text/memo.h"
#include "base/text/plain.h"
#include "base/unit.h"
#include "base/version.h"
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

#define NS_PER_MS 1000000L
#define STATUS_BYTES 900
#define LOOK_MS 100 /* between two looks for a module that is not there yet */
#define LOOKS 150   /* of the service, which is started again after them */
#define REMEDY "modprobe vhci-hcd peak_usb"

static const char usage[] = "usage: canwire-usb [--user USER] FILE\n";

static const char help[] =
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
    "Without such a node there is nothing to do, and it ends with status 0. It ends with status 1\n"
    "when vhci-hcd is removed, since only root can begin anew.\n"
    "\n"
    "Exit status: 0, 1 bad configuration or no vhci-hcd, 2 wrong usage; in the service 75 for\n"
    "what another start may mend, such as vhci-hcd.\n";

typedef struct settings {
    const char *user;
    const char *file;
} settings;

static volatile sig_atomic_t stopping, reloading;

/* Only notes the signal: the loop looks at it when its wait has ended. */
static void usb_on_signal(int number)
{
    if (number == SIGHUP)
        reloading = 1;
    else
        stopping = 1;
}

/* ---- Options --------------------------------------------------------------------------------- */

static const char *default_user(void)
{
    return getpwnam("canwire") ? "canwire" : "nobody";
}

/* Reads the command line. Returns -1 to go on, or the exit status. */
static int read_options(settings *out, int argc, char **argv)
{
    bool version = false;
    const option_row rows[] = {
        {"user", .text = &out->user}, {"version", .flag = &version}, {.name = NULL}};
    const option_table table = {.usage = usage, .help = help, .rows = rows};
    plain_options(argc, argv);
    const int status = options_read(&table, argc, argv);
    if (status >= 0)
        return status;
    if (version) {
        puts("canwire-usb " CANWIRE_VERSION);
        return EXIT_SUCCESS;
    }
    if (argc - optind != 1)
        return options_refuse(&table);
    out->file = argv[optind];
    return -1;
}

/* ---- Configurations -------------------------------------------------------------------------- */

/* Takes the nodes of a file. Returns false after logging the reasons; nothing has changed then. */
static bool usb_read_file(adapters *a, const char *file)
{
    rig *several = NULL;
    cfg *one = NULL;
    memo errors;
    const bool good = memo_begin(&errors) &&
                      rig_load_either(&several, &one, &(cfg_file){.name = file}, errors.out);
    log_as_is(memo_text(&errors) ? errors.text : "out of memory\n");
    memo_end(&errors);
    if (several)
        adapters_set(a, (const cfg *const *)several->buses, several->bus_count);
    else if (one)
        adapters_set(a, (const cfg *const *)&one, 1);
    rig_free(several);
    cfg_free(one);
    return good;
}

static void explain_nothing(const char *file)
{
    log_info("%s: no node has a port { usb: ... }, there is nothing to do", file);
    (void)sd_notify(0, "READY=1\nSTATUS=No node has a port { usb: ... }");
}

/* ---- The run --------------------------------------------------------------------------------- */

/* Catches signals without SA_RESTART: a wait ends, and the loop looks. */
static void catch_signals(void)
{
    const struct sigaction caught = {.sa_handler = usb_on_signal};
    const struct sigaction ignored = {.sa_handler = SIG_IGN};
    (void)sigaction(SIGTERM, &caught, NULL);
    (void)sigaction(SIGINT, &caught, NULL);
    (void)sigaction(SIGHUP, &caught, NULL);
    (void)sigaction(SIGPIPE, &ignored, NULL);
}

/* Tells the service manager what has changed. */
static void tell_status(const adapters *a)
{
    static char before[STATUS_BYTES];
    char now[STATUS_BYTES];
    adapters_print(now, sizeof now, a);
    if (strcmp(now, before) != 0)
        (void)sd_notifyf(0, "STATUS=%s", now);
    memcpy(before, now, sizeof before);
}

/* Returns false when the kernel's controller is gone. Only root may open the next one, which this
 * process is no more. */
static bool usb_run(adapters *a, const vhci *files, const char *file)
{
    const struct timespec pause = {.tv_nsec = ADAPTERS_TICK_MS * NS_PER_MS};
    bool told = false;
    while (!stopping) {
        if (!vhci_is_there(files)) {
            log_error("the module vhci_hcd has been removed, and all adapters with it: this ends, "
                      "to be started again");
            return false;
        }
        if (reloading) {
            reloading = 0;
            if (!usb_read_file(a, file))
                log_error("%s: not reloaded, all stays as it was", file);
        }
        adapters_tick(a);
        tell_status(a);
        if (!told && adapters_are_ready(a)) {
            told = true;
            (void)sd_notify(0, "READY=1");
        }
        (void)nanosleep(&pause, NULL);
    }
    (void)sd_notify(0, "STOPPING=1");
    return true;
}

/* Logs why the controller cannot be used, with what helps. */
static void complain_vhci(int number)
{
    const char *remedy = number == ENOENT   ? " (" REMEDY ")"
                         : number == EACCES ? " (run it as root)"
                                            : "";
    log_error("the virtual USB host controller: %s%s", strerror(number), remedy);
}

/* Opens the files of the controller. The service waits for them: it is started again only when the
 * module is not there for long, so that the log stays short. Returns 0 or an errno. */
static int open_vhci(vhci *files)
{
    const struct timespec pause = {.tv_nsec = LOOK_MS * NS_PER_MS};
    for (unsigned look = unit_instance() ? LOOKS : 0; !vhci_open(files); look--) {
        const int number = errno;
        if (number != ENOENT || look == 0 || stopping)
            return number;
        if (look == LOOKS)
            (void)sd_notify(0, "STATUS=Waiting for the module vhci_hcd (" REMEDY ")");
        (void)nanosleep(&pause, NULL);
    }
    return 0;
}

/* Runs the adapters of a file that is loaded. Returns the exit status. missing: the errno of
 * open_vhci(), or 0. */
static int run_file(adapters *a, const vhci *files, int missing, const char *file)
{
    bool good = true;
    if (adapters_count(a) == 0) {
        explain_nothing(file);
    } else if (missing != 0) {
        complain_vhci(missing);
        good = false;
    } else {
        good = usb_run(a, files, file);
    }
    return good ? EXIT_SUCCESS : unit_failure();
}

/* Plugs in what the configuration asks for, until it is stopped. */
static int serve_file(const vhci *files, int missing, const char *file)
{
    adapters *a = adapters_new(files);
    int status = a ? EXIT_FAILURE : unit_failure();
    if (a && usb_read_file(a, file))
        status = run_file(a, files, missing, file);
    adapters_free(a);
    return status;
}

/* Tells the service manager why it ends. */
static int usb_end(int status)
{
    char why[LOG_LAST_BYTES];
    log_last_error(why);
    if (status != EXIT_SUCCESS)
        (void)sd_notifyf(0, "STATUS=%s", why);
    return status;
}

/* Only the controller needs root: once it is open the process runs as another user. */
int main(int argc, char **argv)
{
    vhci files;
    standardfds_hold();
    log_set_program("canwire-usb");
    settings s = {.user = default_user()};
    const int status = read_options(&s, argc, argv);
    if (status >= 0)
        return status;
    catch_signals();
    const int missing = open_vhci(&files);
    if (missing != 0 && stopping)
        return EXIT_SUCCESS;
    if (!privileges_become(s.user)) {
        log_error("user %s: %s", s.user, errno == ENOENT ? "no such user" : strerror(errno));
        return usb_end(EXIT_FAILURE);
    }
    return usb_end(serve_file(&files, missing, s.file));
}
