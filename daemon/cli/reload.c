/* SPDX-License-Identifier: MIT
 *
 * reload.c - canwire reload: makes a bus read its configuration again.
 *
 * A service manager knows the file and the process of a bus, and needs the result. It uses --config
 * and --pid.
 */
#include "base/plain.h"
#include "cli/client.h"
#include "cli/command.h"
#include "config/rig.h"

#include <errno.h>
#include <limits.h>
#include <signal.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

static const char usage[] = "canwire reload BUS | --config FILE [--pid PID]";

static const char help[] =
    "Lets canwired read its configuration again. When it is bad, nothing changes, and its errors "
    "are\n"
    "told as FILE:LINE:COLUMN: message. Nodes that do not change keep their state and queues.\n"
    "\n"
    "      --config FILE   the bus that has the control socket of this configuration, or\n"
    "                      all buses of this rig\n"
    "      --pid PID       and is this process; without a control socket it gets SIGHUP, and its\n"
    "                      log tells how that went\n";

typedef struct target {
    const char *file;
    pid_t pid; /* 0: any */
} target;

static bool take_config(void *user, const char *text)
{
    target *t = user;
    t->file = text;
    return true;
}

static bool take_pid(void *user, const char *text)
{
    target *t = user;
    char *end;
    errno = 0;
    long pid = strtol(text, &end, 10);
    if (errno != 0 || *end != '\0' || end == text || pid < 1 || pid > INT_MAX) {
        plain_print(stderr, "canwire reload: --pid %s: expected the number of a process\n", text);
        return false;
    }
    t->pid = (pid_t)pid;
    return true;
}

/* ---- By control socket ----------------------------------------------------------------------- */

/* Returns true for the expected process: a wrong path would reload another bus. */
static bool is_process(const client *c, pid_t pid)
{
    struct ucred peer = {.pid = 0};
    socklen_t size = sizeof peer;
    if (pid == 0)
        return true;
    if (getsockopt(c->fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 && peer.pid == pid)
        return true;
    plain_print(stderr, "canwire: bus %s: that is process %ld, not %ld\n", c->bus, (long)peer.pid,
                (long)pid);
    return false;
}

static int ask(const char *control, pid_t pid)
{
    client c;
    if (!client_open(&c, control))
        return CLI_BAD_INPUT;
    json_t *reply = is_process(&c, pid) ? client_ask(&c, client_request("reload")) : NULL;
    int status = reply ? CLI_OK : CLI_BAD_INPUT;
    json_decref(reply);
    client_close(&c);
    return status;
}

/* ---- By signal ------------------------------------------------------------------------------- */

/* Reports the reload to the service manager. canwired's own report may come after this process has
 * ended, when systemd would take the reload for finished. */
static void report_service_manager(void)
{
    static const char text[] = "RELOADING=1";
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    const char *path = getenv("NOTIFY_SOCKET");
    size_t length = path ? strlen(path) : 0;
    if (length == 0 || length >= sizeof address.sun_path)
        return;
    memcpy(address.sun_path, path, length);
    if (path[0] == '@')
        address.sun_path[0] = '\0';
    int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return;
    (void)sendto(fd, text, strlen(text), MSG_NOSIGNAL, (const struct sockaddr *)&address,
                 (socklen_t)(offsetof(struct sockaddr_un, sun_path) + length));
    (void)close(fd);
}

static int hang_up(const target *t)
{
    if (t->pid == 0) {
        plain_print(stderr, "canwire reload: %s: a bus has no control socket: --pid is needed\n",
                    t->file);
        return CLI_BAD_INPUT;
    }
    report_service_manager();
    if (kill(t->pid, SIGHUP) == 0)
        return CLI_OK;
    plain_print(stderr, "canwire reload: process %ld: %s\n", (long)t->pid, strerror(errno));
    return CLI_BAD_INPUT;
}

static int ask_bus(const target *t, const cfg *config)
{
    char path[PATH_MAX];
    (void)snprintf(path, sizeof path, "%s%s", strchr(config->control, '/') ? "" : "./",
                   config->control);
    return ask(path, t->pid);
}

/* Reloads all buses of a rig. SIGHUP is for all of them at once. */
static int reload_rig(const target *t)
{
    int status = CLI_OK;
    bool all = true; /* have a control socket */
    rig *several = rig_load(t->file, stderr);
    if (!several)
        return CLI_BAD_INPUT;
    for (size_t i = 0; i < several->bus_count; i++)
        all = all && several->buses[i]->control;
    if (!all)
        status = hang_up(t);
    for (size_t i = 0; all && i < several->bus_count; i++)
        if (ask_bus(t, several->buses[i]) != CLI_OK)
            status = CLI_BAD_INPUT;
    rig_free(several);
    return status;
}

static int reload_by_file(const target *t)
{
    if (rig_is_rig(t->file))
        return reload_rig(t);
    cfg *config = cfg_load(t->file, stderr);
    if (!config)
        return CLI_BAD_INPUT;
    int status = config->control ? ask_bus(t, config) : hang_up(t);
    cfg_free(config);
    return status;
}

int cli_reload(int argc, char **argv)
{
    int first = 0;
    target t = {.pid = 0};
    const command c = {.usage = usage,
                       .help = help,
                       .words_max = 1,
                       .options = {{.name = "config", .text = take_config},
                                   {.name = "pid", .text = take_pid}},
                       .user = &t};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    bool named = first < argc;
    if (named == (t.file != NULL) || (named && t.pid != 0)) {
        plain_print(stderr, "usage: %s\n", usage);
        return CLI_USAGE;
    }
    return named ? ask(argv[first], 0) : reload_by_file(&t);
}
