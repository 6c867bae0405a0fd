/* SPDX-License-Identifier: MIT
 *
 * adapters.c - starts a process for each adapter, and unplugs those that do not answer.
 */
#include "usb/adapters.h"

#include "base/log.h"
#include "base/text/chars.h"
#include "config/node/portname.h"
#include "usb/privileges.h"
#include "usb/serve.h"
#include "usb/vhci.h"

#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <net/if.h>
#include <pwd.h>
#include <sched.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

#define SILENT_TICKS 10u /* of this process, which a busy machine delays, too */
#define RETRY_TICKS 10u
#define BARRED_TICKS 100u /* each attempt plugs it in */
#define BACK_TICKS 10u   /* between two looks for an interface that has come back */
#define NAMESPACE_BYTES 80u
#define PATH_BYTES 108u

typedef struct adapter {
    char name[IF_NAMESIZE];
    char netns[NAMESPACE_BYTES]; /* "": none */
    char path[PATH_BYTES];
    int port;     /* -1: not plugged in */
    pid_t server; /* 0: none */
    pid_t namer;
    int beat;     /* signs of life come here */
    unsigned silent;
    unsigned rest; /* ticks until it is tried again */
    bool settled;  /* it has its name, or could not have it */
    bool named;    /* since it was plugged in */
    bool unnamed;  /* there was no process to name it: it is tried again */
    int told;      /* the errno that the log has ... */
    serve_end barred; /* ... and why canwired could not be reached; 0: it could */
    unsigned look; /* ticks until it is looked for again */
    bool claimed;  /* a driver has taken it since it was plugged in */
    bool denied;   /* its socket could not be opened when that was last tried */
    bool wanted;
} adapter;

struct adapters {
    vhci files;
    size_t count;
    adapter all[ADAPTERS_MAX];
};

/* ---- Who may open the socket of a node ------------------------------------------------------- */

#define ACCESS_WHY_BYTES 512u
#define NAME_BYTES 40u
#define MODE_BITS 07777u

/* Returns true for a path that this process may not write to, or not even look for. */
static bool access_is_denied(const char *path)
{
    return faccessat(AT_FDCWD, path, W_OK, AT_EACCESS) != 0 && errno == EACCES;
}

/* Copies a name, or a number without one. */
static void print_name(char out[NAME_BYTES], const char *name, unsigned number)
{
    if (name)
        (void)snprintf(out, NAME_BYTES, "%s", name);
    else
        (void)snprintf(out, NAME_BYTES, "%u", number);
}

static void print_user(char out[NAME_BYTES], uid_t user)
{
    const struct passwd *found = getpwuid(user);
    print_name(out, found ? found->pw_name : NULL, user);
}

static void print_group(char out[NAME_BYTES], gid_t group)
{
    const struct group *found = getgrgid(group);
    print_name(out, found ? found->gr_name : NULL, group);
}

/* Finds what this process can see of a path: itself, or the folder that it may not enter. */
static bool find_seen(char seen[PATH_BYTES], struct stat *what, const char *path)
{
    (void)snprintf(seen, PATH_BYTES, "%s", path);
    while (stat(seen, what) != 0) {
        char *slash = strrchr(seen, '/');
        if (errno != EACCES || !slash || slash == seen)
            return false;
        *slash = '\0';
    }
    return true;
}

/* Writes what may not be opened, whose it is, and who this process is. */
static void access_explain(char why[ACCESS_WHY_BYTES], const char *path)
{
    char seen[PATH_BYTES], me[NAME_BYTES], owner[NAME_BYTES], group[NAME_BYTES];
    struct stat what;
    print_user(me, geteuid());
    if (!find_seen(seen, &what, path)) {
        (void)snprintf(why, ACCESS_WHY_BYTES, "user %s may not open %s", me, path);
        return;
    }
    print_user(owner, what.st_uid);
    print_group(group, what.st_gid);
    (void)snprintf(why, ACCESS_WHY_BYTES, "user %s may not %s %s (owner %s, group %s, mode %04o)",
                   me, S_ISDIR(what.st_mode) ? "enter the folder" : "open the socket", seen, owner,
                   group, what.st_mode & MODE_BITS);
}

adapters *adapters_new(const vhci *files)
{
    adapters *a = calloc(1, sizeof *a);
    if (a)
        a->files = *files;
    return a;
}

/* ---- Processes ------------------------------------------------------------------------------- */

/* A child must not live longer than this process, or nobody would look after it. */
static void begin_child(pid_t parent)
{
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL);
    (void)signal(SIGTERM, SIG_DFL);
    (void)signal(SIGINT, SIG_DFL);
    (void)signal(SIGHUP, SIG_IGN);
    if (getppid() != parent)
        _exit(EXIT_FAILURE);
}

/* canwired wakes up the processes of all adapters with each frame. None may take its processor
 * before it has told the others. With eight adapters this makes a tenfold difference on a slow
 * machine. */
static void be_patient(void)
{
    const struct sched_param none = {.sched_priority = 0};
    (void)sched_setscheduler(0, SCHED_BATCH, &none);
}

static _Noreturn void end_child(int status)
{
    log_end();
    _exit(status);
}

/* Answers for an adapter, in a process of its own without any rights. The kernel keeps the device
 * for as long as that lives. */
static _Noreturn void run_server(const adapters *all, const adapter *a, int kernel, int beat,
                                 pid_t parent)
{
    usb_identity who = {.number = (uint32_t)a->port};
    (void)snprintf(who.serial, sizeof who.serial, "%s%s%s", a->netns, *a->netns ? "." : "",
                   a->name);
    begin_child(parent);
    (void)close(all->files.attach);
    (void)close(all->files.detach);
    be_patient();
    if (!privileges_drop_all()) {
        log_node_error(a->name, "privileges: %s", strerror(errno));
        end_child(EXIT_FAILURE);
    }
    end_child((int)serve(kernel, beat, &who, a->path));
}

/* Starts the process that gives the interface its name: that waits for the kernel, and this process
 * must not. */
static void start_namer(adapter *a)
{
    const pid_t parent = getpid();
    const pid_t namer = fork();
    a->namer = namer > 0 ? namer : 0;
    a->unnamed = namer < 0;
    if (namer != 0)
        return;
    begin_child(parent);
    end_child(name_interface(a->port, a->name, *a->netns ? a->netns : NULL) ? EXIT_SUCCESS
                                                                            : EXIT_FAILURE);
}

/* Kills a process and waits for its end, so that its number can be nobody else's. */
static void stop_process(pid_t *process)
{
    if (*process <= 0)
        return;
    (void)kill(*process, SIGKILL);
    while (waitpid(*process, NULL, 0) < 0 && errno == EINTR)
        continue;
    *process = 0;
}

/* ---- One adapter ----------------------------------------------------------------------------- */

/* Unplugs an adapter, and ends its processes. It rests before it is plugged in again. */
static void unplug(adapters *all, adapter *a)
{
    if (a->port < 0)
        return;
    vhci_detach(&all->files, a->port);
    stop_process(&a->server);
    stop_process(&a->namer);
    (void)close(a->beat);
    a->beat = -1;
    a->port = -1;
    a->named = a->claimed = false;
    a->rest = RETRY_TICKS;
}

/* Says why an adapter cannot be plugged in, once for each reason. */
static void adapters_complain(adapter *a, int number)
{
    if (a->told != number)
        log_node_error(a->name, "it cannot be plugged in: %s%s", strerror(number),
                       number == EBUSY ? " (all ports of vhci-hcd are taken)" : "");
    a->told = number;
    a->settled = true;
    a->rest = RETRY_TICKS;
}

/* Says who may not open the socket of an adapter, and why, as far as its mode tells. */
static void explain_forbidden(const adapter *a)
{
    char text[ACCESS_WHY_BYTES];
    access_explain(text, a->path);
    log_node_error(a->name, "%s%s: it is not plugged in until that changes; --user names another "
                   "user", text, access_is_denied(a->path)
                   ? "" : ", though not for its mode: AppArmor or SELinux may forbid it");
}

/* Says once why an adapter is not plugged in. */
static void complain_barred(adapter *a, serve_end why)
{
    if (a->barred != why && why == SERVE_FORBIDDEN)
        explain_forbidden(a);
    else if (a->barred != why && why == SERVE_FULL)
        log_node_error(a->name, "the port %s has as many programs as it takes (clients: max): it "
                       "is not plugged in while they are there", a->path);
    else if (a->barred != why)
        log_node_error(a->name, "its node has a controller already, such as another canwire-usb "
                       "(%s): it is not plugged in while that is there", a->path);
    a->barred = why;
    a->settled = true;
    a->rest = RETRY_TICKS;
}

/* Tells once that the namespace is missing. It is looked for again later. */
static void complain_namespace(adapter *a)
{
    if (a->told != ENOENT)
        log_node_error(a->name, "there is no network namespace %s: it is not plugged in until "
                       "there is (ip netns add %s)", a->netns, a->netns);
    a->told = ENOENT;
    a->settled = true;
    a->rest = RETRY_TICKS;
}

/* Returns false, after saying why, for an adapter whose interface would be of no use. */
static bool may_plug_in(adapter *a)
{
    const bool before = a->denied;
    a->denied = access_is_denied(a->path);
    if (a->denied && before)
        complain_barred(a, SERVE_FORBIDDEN);
    else if (a->denied)
        a->rest = RETRY_TICKS; /* a new socket gets its group a moment later */
    else if (!*a->netns || naming_has_namespace(a->netns))
        return true;
    else
        complain_namespace(a);
    return false;
}

/* Finds a port that is free, and none of our own. */
static int find_port(const adapters *all)
{
    int used[ADAPTERS_MAX];
    size_t count = 0;
    for (size_t i = 0; i < all->count; i++)
        if (all->all[i].port >= 0)
            used[count++] = all->all[i].port;
    return vhci_find_port(used, count);
}

/* The kernel asks the device who it is as soon as it is plugged in, so the server comes first. */
static bool start_server(const adapters *all, adapter *a, const int kernel[2], const int beat[2])
{
    const pid_t parent = getpid();
    a->server = fork();
    if (a->server == 0) {
        (void)close(kernel[0]);
        (void)close(beat[0]);
        run_server(all, a, kernel[1], beat[1], parent);
    }
    a->beat = beat[0];
    return a->server > 0 && vhci_attach(&all->files, a->port, kernel[0]);
}

/* Plugs an adapter in: its process answers the kernel before the kernel asks. */
static void plug_in(adapters *all, adapter *a)
{
    int kernel[2], beat[2];
    if (!may_plug_in(a))
        return;
    a->port = find_port(all);
    if (a->port < 0) {
        adapters_complain(a, errno);
        return;
    }
    if (pipe2(beat, O_CLOEXEC | O_NONBLOCK) != 0 ||
        socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, kernel) != 0) {
        a->port = -1; /* without descriptors the process is of no more use: systemd's limit */
        adapters_complain(a, errno);
        return;
    }
    const bool good = start_server(all, a, kernel, beat);
    const int number = errno;
    (void)close(kernel[0]); /* the kernel keeps it */
    (void)close(kernel[1]);
    (void)close(beat[1]);
    a->silent = 0;
    if (!good) {
        unplug(all, a);
        adapters_complain(a, number);
        return;
    }
    start_namer(a);
}

/* *result: its exit status; EXIT_FAILURE for one that was killed. */
static bool has_ended(pid_t *process, int *result)
{
    int status;
    if (*process <= 0 || waitpid(*process, &status, WNOHANG) != *process)
        return false;
    *process = 0;
    *result = WIFEXITED(status) ? WEXITSTATUS(status) : EXIT_FAILURE;
    return true;
}

/* Takes the result of naming. An interface without its name is of no use: the adapter is
 * unplugged. */
static void look_at_namer(adapters *all, adapter *a)
{
    int result;
    if (!has_ended(&a->namer, &result))
        return;
    a->settled = true;
    if (result == EXIT_SUCCESS) {
        a->told = 0;
        log_node_info(a->name, "%s at port %d of vhci-hcd%s%s",
                      a->named ? "it has its name again" : "plugged in", a->port,
                      *a->netns ? ", in namespace " : "", a->netns);
        a->named = true;
    } else {
        unplug(all, a);
    }
}

/* Counts the signs of a driver that has taken the device; others are signs of life. */
static unsigned count_claims(const char *signs, ssize_t count)
{
    unsigned claims = 0;
    for (ssize_t i = 0; i < count; i++)
        claims += signs[i] == SERVE_CLAIMED;
    return claims;
}

/* Takes the signs. A driver that is bound again makes a new interface, with a name of its own, as
 * is after a suspend of the device. A process that is naming may have seen the one before. The
 * first interface is for the process that was started with the adapter. It may be moved by now. */
static void look_at_beat(adapter *a)
{
    char signs[64];
    const ssize_t count = read(a->beat, signs, sizeof signs);
    a->silent = count > 0 ? 0 : a->silent + 1;
    const unsigned claims = count_claims(signs, count);
    const bool anew = claims > (a->claimed ? 0u : 1u);
    a->claimed = a->claimed || claims > 0;
    if (count > 0 && memchr(signs, SERVE_LINKED, (size_t)count))
        a->barred = SERVE_UNPLUGGED;
    if (anew)
        stop_process(&a->namer);
    if ((anew || a->unnamed) && a->namer == 0)
        start_namer(a);
}

/* Returns true for an interface that has been moved and is here again. The kernel does that when
 * its namespace is deleted. */
static bool has_come_back(adapter *a)
{
    if (!*a->netns || !a->named || a->namer > 0 || a->look-- > 0)
        return false;
    a->look = BACK_TICKS;
    return naming_find(a->port) != 0;
}

/* Looks for an interface that is back because its namespace has gone. It is moved again if there is
 * a new one; otherwise the adapter is unplugged. */
static void look_for_interface(adapters *all, adapter *a)
{
    if (!has_come_back(a))
        return;
    log_node_warning(a->name, "it is back from namespace %s, and down", a->netns);
    if (naming_has_namespace(a->netns))
        start_namer(a);
    else
        unplug(all, a);
}

/* Takes the end of the process of an adapter. One that is barred rests longer, if only an attempt
 * tells whether it still is. */
static void look_at_end(adapters *all, adapter *a, int result)
{
    unplug(all, a);
    if (result != SERVE_FORBIDDEN && result != SERVE_TAKEN && result != SERVE_FULL) {
        log_node_warning(a->name, "unplugged%s",
                         result == SERVE_UNPLUGGED ? " by the kernel" : ": its process has ended");
        return;
    }
    complain_barred(a, (serve_end)result);
    if (!access_is_denied(a->path)) /* only another attempt tells whether it is let in */
        a->rest = BARRED_TICKS;
}

/* Does what is due for an adapter. It is called once a tick. */
static void look_after(adapters *all, adapter *a)
{
    int result;
    if (a->port < 0) {
        a->rest -= a->rest > 0;
        if (a->rest == 0)
            plug_in(all, a);
        return;
    }
    look_at_beat(a);
    if (has_ended(&a->server, &result)) {
        look_at_end(all, a, result);
    } else if (a->silent >= SILENT_TICKS) {
        log_node_error(a->name, "its process does not answer: unplugged, so that the network's "
                                "configuration does not wait for it");
        unplug(all, a);
    } else {
        look_at_namer(all, a);
        look_for_interface(all, a);
    }
}

/* ---- All ------------------------------------------------------------------------------------- */

void adapters_free(adapters *a)
{
    for (size_t i = 0; a && i < a->count; i++)
        unplug(a, &a->all[i]);
    free(a);
}

void adapters_tick(adapters *a)
{
    for (size_t i = 0; i < a->count; i++)
        look_after(a, &a->all[i]);
}

bool adapters_are_ready(const adapters *a)
{
    for (size_t i = 0; i < a->count; i++)
        if (!a->all[i].settled)
            return false;
    return true;
}

size_t adapters_count(const adapters *a)
{
    return a->count;
}

static bool is_well(const adapter *a)
{
    return a->port >= 0 && a->named;
}

/* Returns the state of an adapter in words, for the status of the service. */
static const char *state_of(const adapter *a)
{
    if (a->port >= 0)
        return a->named ? "plugged in" : "gets its name";
    if (a->barred == SERVE_FORBIDDEN)
        return "may not open its socket";
    if (a->barred == SERVE_FULL)
        return "finds its port full";
    if (a->barred == SERVE_TAKEN)
        return "finds another controller at its node";
    if (a->told == ENOENT)
        return "waits for its namespace";
    if (a->told == EBUSY)
        return "finds no free port of vhci-hcd";
    return "is not plugged in";
}

void adapters_print(char *out, size_t size, const adapters *a)
{
    size_t well = 0;
    for (size_t i = 0; i < a->count; i++)
        well += is_well(&a->all[i]);
    size_t used = chars_print(out, size, 0, "%zu of %zu plugged in", well, a->count);
    for (size_t i = 0; i < 2 * a->count; i++) {
        const adapter *one = &a->all[i % a->count];
        if (is_well(one) == (i >= a->count))
            used = chars_print(out, size, used, "%s%s%s%s %s", strchr(out, ':') ? ", " : ": ",
                               one->name, *one->netns ? " of " : "", one->netns, state_of(one));
    }
}

/* Copies what it needs, since the configuration does not stay. */
static adapter make_adapter(const cfg_node *node)
{
    adapter made = {.port = -1, .beat = -1, .wanted = true};
    (void)snprintf(made.name, sizeof made.name, "%s", node->peer);
    (void)snprintf(made.netns, sizeof made.netns, "%s", node->netns ? node->netns : "");
    (void)snprintf(made.path, sizeof made.path, "%s", portname_parse(node->port).path);
    return made;
}

static bool adapters_is_same(const adapter *a, const adapter *b)
{
    return strcmp(a->name, b->name) == 0 && strcmp(a->netns, b->netns) == 0 &&
           strcmp(a->path, b->path) == 0;
}

/* Marks the adapter of a node as wanted, or adds it. Others are unplugged after a reload. */
static void want(adapters *a, const cfg_node *node)
{
    const adapter made = make_adapter(node);
    for (size_t i = 0; i < a->count; i++)
        if (adapters_is_same(&a->all[i], &made)) {
            a->all[i].wanted = true;
            return;
        }
    if (a->count < ADAPTERS_MAX)
        a->all[a->count++] = made;
}

void adapters_set(adapters *a, const cfg *const *buses, size_t count)
{
    size_t kept = 0;
    for (size_t i = 0; i < a->count; i++)
        a->all[i].wanted = false;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < buses[i]->node_count; k++)
            if (cfg_is_usb(&buses[i]->nodes[k]))
                want(a, &buses[i]->nodes[k]);
    for (size_t i = 0; i < a->count; i++) {
        if (a->all[i].wanted)
            a->all[kept++] = a->all[i];
        else
            unplug(a, &a->all[i]);
    }
    a->count = kept;
}
