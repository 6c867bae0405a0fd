/* SPDX-License-Identifier: MIT
 *
 * reload.c - canwire reload: makes a bus read its configuration again.
 *
 * A service manager knows the file and the process of a bus, and needs the result. It uses --config
 * and --pid.
 */
#include "base/text/jsonput.h"

#include "base/text/memo.h"
#include "base/text/number.h"
#include "base/text/plain.h"
#include "cli/buses.h"
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
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

static const char usage[] = "canwire reload BUS | --config FILE [--pid PID]";

static const char help[] =
    "Lets canwired read its configuration again. When it is bad, nothing changes, and its errors "
    "are\n"
    "told as FILE:LINE:COLUMN: message. Nodes that do not change keep their state and queues. "
    "Kept\n"
    "rules (canwire inject --keep) that do not fit any more are told, and wait.\n"
    "\n"
    "      --config FILE   the bus that has the control socket of this configuration, or\n"
    "                      all buses of this rig\n"
    "      --pid PID       and is this process; without a control socket it gets SIGHUP, and its\n"
    "                      log tells how that went\n";

typedef struct target {
    const char *file;
    pid_t pid; /* 0: any */
} target;

/* Takes the number of a process. 0 would be all of a group. */
static bool take_pid(void *out, const char *option, const char *text)
{
    const char *end = text;
    uint64_t pid = 0;
    if (!text_take_digits(&pid, &end, INT_MAX) || *end || pid == 0) {
        plain_print(stderr, "canwire reload: %s %s: expected the number of a process\n", option,
                    text);
        return false;
    }
    *(pid_t *)out = (pid_t)pid;
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

/* Returns true for one file by two names. */
static bool is_same_file(const char *a, const char *b)
{
    struct stat of_a, of_b;
    return strcmp(a, b) == 0 || (stat(a, &of_a) == 0 && stat(b, &of_b) == 0 &&
                                 of_a.st_dev == of_b.st_dev && of_a.st_ino == of_b.st_ino);
}

/* Returns true when the bus of a status, or its rig, has that file. A canwired of an earlier
 * version does not name its rig. */
static bool has_file(const json_t *status, const char *file)
{
    static const char *const keys[] = {"file", "rig"};
    char *here = getcwd(NULL, 0);
    char *wanted = client_path_in(here, file);
    bool same = !json_object_get(status, "rig") && rig_is_rig(file);
    for (size_t i = 0; wanted && i < 2 && !same; i++) {
        char *own = client_file_of(status, keys[i]);
        same = own && is_same_file(own, wanted);
        free(own);
    }
    free(wanted);
    free(here);
    return same;
}

/* Returns true for the bus of the file: a wrong process would reload another configuration. */
static bool is_of_file(client *c, const char *file)
{
    if (!file)
        return true;
    c->exact = true;
    json_t *reply = client_ask(c, client_request("status"));
    c->exact = false;
    const json_t *status = json_object_get(reply, "status");
    const bool same = has_file(status, file);
    const char *rig_file = get_text(status, "rig");
    const char *own = get_text(status, "file");
    if (reply && !same)
        plain_print(stderr, "canwire: bus %s: it runs with %s, not with %s\n", c->bus,
                    rig_file ? rig_file : own ? own : "another file", file);
    json_decref(reply);
    return reply && same;
}

/* Tells of kept rules that the bus refuses with its new configuration. It has gone over all the
 * same. */
static void tell_refused_rules(client *c)
{
    json_t *reply = client_ask(c, client_request("status"));
    const json_t *kept = json_object_get(json_object_get(reply, "status"), "kept_rules");
    for (size_t i = 0; i < json_array_size(kept); i++) {
        const json_t *one = json_array_get(kept, i);
        if (json_is_true(json_object_get(one, "refused")))
            plain_print(stderr, "canwire: bus %s: rules of %s, which are kept, are refused: %s\n",
                        c->bus, get_any_text(one, "name"), get_any_text(one, "why"));
    }
    json_decref(reply);
}

/* file: NULL for any */
static int ask(const char *control, const char *file, pid_t pid)
{
    client c;
    if (!client_open(&c, control))
        return CLI_BAD_INPUT;
    const bool good = is_process(&c, pid) && is_of_file(&c, file);
    json_t *reply = good ? client_ask(&c, client_request("reload")) : NULL;
    int status = reply ? CLI_OK : CLI_BAD_INPUT;
    if (reply)
        tell_refused_rules(&c);
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

/* Reloads by a signal, which gives no answer. So it is only for a bus without a control socket. */
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

/* ---- Which buses ----------------------------------------------------------------------------- */

static void print_control(char path[PATH_MAX], const cfg *config)
{
    (void)snprintf(path, PATH_MAX, "%s%s", strchr(config->control, '/') ? "" : "./",
                   config->control);
}

/* Returns true when each bus has a control socket. */
static bool have_control(cfg *const *buses, size_t count)
{
    bool all = true;
    for (size_t i = 0; i < count; i++)
        all = all && buses[i]->control;
    return all;
}

/* Asks all buses. It says where nobody listens, and lets the process find the mistake: it may have
 * another socket than its file says by now. */
static int ask_buses(const target *t, cfg *const *buses, size_t count)
{
    char path[PATH_MAX];
    int status = CLI_OK;
    bool lost = false;
    for (size_t i = 0; i < count; i++) {
        print_control(path, buses[i]);
        lost = lost || buses_listener(path) == BUSES_NOBODY;
        if (ask(path, t->file, t->pid) != CLI_OK)
            status = CLI_BAD_INPUT;
    }
    if (t->pid != 0 && lost)
        (void)hang_up(t);
    return status;
}

/* Returns true when the control sockets of the buses are of the process. */
static bool are_of_process(const target *t, cfg *const *buses, size_t count)
{
    char path[PATH_MAX];
    bool good = have_control(buses, count);
    for (size_t i = 0; i < count && good && t->pid != 0; i++) {
        print_control(path, buses[i]);
        good = buses_listener(path) == t->pid;
    }
    return good;
}

/* Finds the control sockets of the process among those of all buses that run. */
static size_t find_process(char *paths[BUSES_MAX], const target *t)
{
    char *names[BUSES_MAX];
    size_t found = 0;
    const size_t count = t->pid != 0 ? buses_find(names, BUSES_MAX, false) : 0;
    for (size_t i = 0; i < count; i++) {
        char *path = buses_path(names[i]);
        free(names[i]);
        if (path && buses_listener(path) == t->pid)
            paths[found++] = path;
        else
            free(path);
    }
    return found;
}

/* Asks the buses of the process, wherever their file says that they are. Returns false when there
 * are fewer than expected. */
static bool ask_process(int *status, const target *t, size_t expected)
{
    char *paths[BUSES_MAX];
    const size_t found = find_process(paths, t);
    const bool good = found > 0 && found >= expected;
    *status = CLI_OK;
    for (size_t i = 0; i < found; i++) {
        if (good && ask(paths[i], t->file, t->pid) != CLI_OK)
            *status = CLI_BAD_INPUT;
        free(paths[i]);
    }
    return good;
}

/* Reloads the buses of a file that is good. The process may still have their control sockets where
 * an earlier version of the file put them. */
static int reload_buses(const target *t, cfg *const *buses, size_t count)
{
    int status;
    if (!are_of_process(t, buses, count) && ask_process(&status, t, count))
        return status;
    return have_control(buses, count) ? ask_buses(t, buses, count) : hang_up(t);
}

/* A file that is bad is for the bus to refuse: its status says so then. */
static int reload_bad(const target *t, const char *errors)
{
    int status;
    if (ask_process(&status, t, 1))
        return status;
    fputs(errors, stderr);
    if (t->pid != 0)
        (void)hang_up(t);
    return CLI_BAD_INPUT;
}

/* Reloads what runs by a file. A file that is bad is still told to the bus, which says so in its
 * status. */
static int reload_by_file(const target *t)
{
    memo errors;
    rig *several = NULL;
    cfg *one = NULL;
    if (!memo_begin(&errors))
        return CLI_BAD_INPUT;
    (void)rig_load_either(&several, &one, &(cfg_file){.name = t->file}, errors.out);
    int status = several ? reload_buses(t, several->buses, several->bus_count)
                 : one   ? reload_buses(t, &one, 1)
                         : reload_bad(t, memo_text(&errors) ? errors.text : "");
    rig_free(several);
    cfg_free(one);
    memo_end(&errors);
    return status;
}

int cli_reload(int argc, char **argv)
{
    int first = 0;
    target t = {.pid = 0};
    const command c = {.usage = usage,
                       .help = help,
                       .words_max = 1,
                       .options = {{"config", .text = &t.file},
                                   {"pid", .read = take_pid, .out = &t.pid}}};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    bool named = first < argc;
    if (named == (t.file != NULL) || (named && t.pid != 0)) {
        plain_print(stderr, "usage: %s\n", usage);
        return CLI_USAGE;
    }
    return named ? ask(argv[first], NULL, 0) : reload_by_file(&t);
}
