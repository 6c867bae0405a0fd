/* SPDX-License-Identifier: MIT
 *
 * vcan.c - canwire vcan: makes and removes the interfaces of a configuration.
 *
 * An alias, "canwire FILE", marks its interfaces. So it removes these and no others, even if the
 * file has changed. The alias also contains the peer: a different peer needs another pair.
 */
#include "base/options.h"
#include "base/text/plain.h"
#include "base/unit.h"
#include "cli/cli.h"
#include "config/config.h"
#include "config/node/fdnodes.h"
#include "config/node/portname.h"
#include "config/rig.h"
#include "port/claim.h"
#include "port/links.h"

#include <errno.h>
#include <fcntl.h>
#include <getopt.h>
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define NETNS_FOLDER "/run/netns/" /* the folder of `ip netns` */
#define OWNER_MAX 160u             /* leaves room for the peer in an alias */
#define PEER_BYTES 96u             /* ": NAME in NETNS" */

static const char usage[] = "usage: canwire vcan up|down FILE\n";

static const char help[] =
    "Makes or removes the network interfaces that the configuration FILE names.\n"
    "\n"
    "  up     makes those that are missing and sets all up: vcan, or for a node with a\n"
    "         peer a pair of vxcan with the other end in the network namespace of the peer;\n"
    "         with \"vxcan: yes\" in FILE a pair for each, the ECU's end called as its node\n"
    "  down   removes what `up` has made for FILE, which need not be there any more, but for\n"
    "         interfaces that a running bus uses: then it fails. It also fails when neither FILE\n"
    "         nor an interface of it is there\n"
    "\n"
    "  -h, --help   this text\n"
    "\n"
    "What `up` makes has an MTU of 72 where the node knows CAN FD, else one of 16, so\n"
    "that a program that writes CAN FD frames gets an error. It changes that of its own\n"
    "interfaces when their node has changed: a vcan is down for a moment, and a pair is\n"
    "made anew.\n"
    "\n"
    "An interface that is there already is used when it is of the right kind, and never\n"
    "removed; one of another kind is refused, before anything is made. What `up` has made\n"
    "has the alias \"canwire FILE\" (`ip link show`). When a peer has changed, its pair\n"
    "is made anew. With \"missing-port: wait\" of the bus, real CAN interfaces are left\n"
    "alone, and can0, slcan0 and the like are not made: they are those of adapters, and\n"
    "the bus waits for them. The same key of a node is for any name. With a peer they\n"
    "are made.\n"
    "\n"
    "Namespaces have to be there: `ip netns add NAME`. Needs root, or\n"
    "CAP_NET_ADMIN.\n"
    "\n"
    "Exit status: 0, 1 bad input or refused, 2 wrong usage.\n";

/* The step that the port of a node needs. */
typedef enum step {
    STEP_NONE = 0,
    STEP_SET_UP,
    STEP_MAKE,
    STEP_REPLACE,
    STEP_MTU,
    STEP_LEAVE /* it is not made, as hardware comes under this name */
} step;

typedef struct plan {
    links *links;
    const char *owner; /* "canwire FILE" */
    const cfg *config;
    uint64_t fd; /* nodes that know CAN FD */
    step steps[CW_NODES_MAX];
    bool made[CW_NODES_MAX];
} plan;

static int vcan_run(const char *verb, const char *file);

int cli_vcan(int argc, char **argv)
{
    const option_row none = {.name = NULL};
    const option_table table = {.usage = usage, .help = help, .rows = &none};
    const int status = options_read(&table, argc, argv);

    if (status >= 0)
        return status;
    const char *verb = argc - optind == 2 ? argv[optind] : "";
    if (strcmp(verb, "up") == 0 || strcmp(verb, "down") == 0)
        return vcan_run(verb, argv[optind + 1]);
    return options_refuse(&table);
}

/* Complains with a message and the reason from the kernel or the system. */
static bool vcan_complain(const char *what, const char *why)
{
    plain_print(stderr, "canwire vcan: %s: %s\n", what, why);
    return false;
}

/* Returns what the user can do about an error of the kernel. */
static const char *remedy(int number)
{
    switch (number) {
    case EPERM:
        return " (run it as root)";
    case EOPNOTSUPP:
        return " (this kernel has no vcan or vxcan: modprobe vcan vxcan)";
    default:
        return "";
    }
}

static bool complain_link(const plan *p, const char *verb, const char *name, int number)
{
    plain_print(stderr, "canwire vcan: cannot %s %s: %s%s\n", verb, name, links_error(p->links),
                remedy(number));
    return false;
}

/* ---- Ownership ------------------------------------------------------------------------------- */

/* Resolves FILE to an absolute path. Symbolic links stay, and the file need not exist. */
static bool resolve(char out[PATH_MAX], const char *file)
{
    char folder[PATH_MAX];
    char real[PATH_MAX];
    const char *slash = strrchr(file, '/');
    const char *base = slash ? slash + 1 : file;
    int length =
        snprintf(folder, sizeof folder, "%.*s", slash ? (int)(base - file) : 1, slash ? file : ".");

    if (length >= (int)sizeof folder || !realpath(folder, real))
        return vcan_complain(file, strerror(length >= (int)sizeof folder ? ENAMETOOLONG : errno));
    if (snprintf(out, PATH_MAX, "canwire %s/%s", strcmp(real, "/") ? real : "", base) <=
        (int)OWNER_MAX)
        return true;
    return vcan_complain(file, "the path is too long for the alias of an interface");
}

static void print_peer(char out[PEER_BYTES], const cfg_node *node)
{
    (void)snprintf(out, PEER_BYTES, "%s%s%s%s", node->peer ? ": " : "",
                   node->peer ? node->peer : "", node->netns ? " in " : "",
                   node->netns ? node->netns : "");
}

/* Prints the alias by which `down` knows its interfaces again: the file, and the peer. */
static void print_alias(char out[LINKS_ALIAS_BYTES], const char *owner, const cfg_node *node)
{
    char peer[PEER_BYTES];

    print_peer(peer, node);
    (void)snprintf(out, LINKS_ALIAS_BYTES, "%.*s%s", (int)OWNER_MAX, owner, peer);
}

/* Returns true for an interface whose alias names this file as its owner. */
static bool is_ours(const char *owner, const link_info *info)
{
    size_t length = strlen(owner);

    return strncmp(info->alias, owner, length) == 0 &&
           (info->alias[length] == '\0' || strncmp(info->alias + length, ": ", 2) == 0);
}

/* ---- Up -------------------------------------------------------------------------------------- */

static unsigned mtu_of(const plan *p, size_t node)
{
    return p->fd >> node & 1u ? CANFD_MTU : CAN_MTU;
}

/* Decides the step for an existing interface. Of a pair, the other end may be in another namespace
 * by now. */
static bool vcan_judge(step *out, const plan *p, size_t index, const link_info *info)
{
    const cfg_node *node = &p->config->nodes[index];
    char alias[LINKS_ALIAS_BYTES];
    bool pair = strcmp(info->kind, "vxcan") == 0;

    print_alias(alias, p->owner, node);
    *out = info->up ? STEP_NONE : STEP_SET_UP;
    const bool ours = is_ours(p->owner, info);
    if (ours && info->mtu != mtu_of(p, index))
        *out = pair ? STEP_REPLACE : STEP_MTU;
    if (ours && strcmp(info->alias, alias) != 0)
        *out = STEP_REPLACE;
    else if (!pair && node->peer)
        return vcan_complain(node->port,
                             "it exists and is no vxcan interface, but has a peer in FILE");
    else if (!pair && strcmp(info->kind, "vcan") != 0)
        return vcan_complain(node->port, "it exists and is no vcan or vxcan interface");
    return true;
}

/* Warns only: an interface of somebody else is not set down to change its MTU. */
static void warn_of_mtu(const cfg_node *node, const link_info *info, unsigned mtu)
{
    const bool fd = mtu == CANFD_MTU;
    if ((info->mtu >= CANFD_MTU) == fd)
        return;
    plain_print(stderr,
                "canwire vcan: %s: it exists with an MTU of %u: CAN FD frames %s (ip link set %s "
                "down; ip link set %s mtu %u up)\n",
                node->port, (unsigned)info->mtu,
                fd ? "cannot be written to it"
                   : "can be written to it, and get lost, since the node knows none",
                node->port, node->port, mtu);
}

/* Returns true for a name that the kernel gives to hardware: can0, slcan12. */
static bool is_hardware_name(const char *name)
{
    const char *number = name + (strncmp(name, "sl", 2) == 0 ? 2 : 0);
    if (strncmp(number, "can", 3) != 0 || number[3] == '\0')
        return false;
    return number[3 + strspn(number + 3, "0123456789")] == '\0';
}

/* Returns true for a port that hardware has, or will have: then the bus has to wait for it. A vcan
 * of its name would take its place. The node says so, or the bus for names that the kernel gives.
 * info is NULL when the port is missing. */
static bool is_for_hardware(const cfg *config, const cfg_node *node, const link_info *info)
{
    const bool named =
        node->missing_port == CFG_MISSING_PORT_WAIT || is_hardware_name(node->port);
    if (node->peer || !cfg_waits_for_port(config, node))
        return false;
    if (!info)
        return named;
    return strcmp(info->kind, "can") == 0 ||
           (info->kind[0] == '\0' && named); /* slcan before Linux 6.0 */
}

/* Returns a descriptor of the namespace, -1 with errno: `ip netns add` has not made it. */
static int open_netns(const cfg_node *node)
{
    char path[sizeof NETNS_FOLDER + NAME_MAX];

    (void)snprintf(path, sizeof path, NETNS_FOLDER "%s", node->netns);
    return open(path, O_RDONLY | O_CLOEXEC);
}

/* Plans the steps of a port without changing anything. */
static bool plan_port(plan *p, size_t i)
{
    const cfg_node *node = &p->config->nodes[i];
    link_info info;
    int number = links_find(p->links, &info, node->port);

    if (number != 0 && number != ENODEV)
        return complain_link(p, "look at", node->port, number);
    if (is_for_hardware(p->config, node, number == 0 ? &info : NULL)) {
        p->steps[i] = number == 0 ? STEP_NONE : STEP_LEAVE;
        return true;
    }
    p->steps[i] = STEP_MAKE;
    if (number == 0 && !vcan_judge(&p->steps[i], p, i, &info))
        return false;
    if (number == 0 && p->steps[i] != STEP_REPLACE && p->steps[i] != STEP_MTU)
        warn_of_mtu(node, &info, mtu_of(p, i));
    if (!node->netns)
        return true;
    int fd = open_netns(node);
    if (fd < 0) {
        plain_print(stderr, "canwire vcan: network namespace %s: %s%s\n", node->netns,
                    strerror(errno), errno == ENOENT ? " (make it: ip netns add NAME)" : "");
        return false;
    }
    (void)close(fd);
    return true;
}

/* Makes a vxcan, whose other end may be in a namespace. Returns 0 or an errno. */
static int make_pair(plan *p, size_t index)
{
    const cfg_node *node = &p->config->nodes[index];
    int fd = node->netns ? open_netns(node) : -1;
    if (node->netns && fd < 0)
        return errno; /* it has gone since the plan */
    int number = links_make_vxcan(p->links, node->port, node->peer, fd, mtu_of(p, index));

    if (fd >= 0)
        (void)close(fd);
    return number;
}

/* Makes an interface. It is noted as made before anything else can fail, so that it can be
 * removed. */
static bool vcan_make(plan *p, size_t i)
{
    const cfg_node *node = &p->config->nodes[i];
    char alias[LINKS_ALIAS_BYTES];
    char peer[PEER_BYTES];
    int number = node->peer ? make_pair(p, i) : links_make_vcan(p->links, node->port, mtu_of(p, i));

    print_peer(peer, node);
    if (number != 0) {
        char name[IF_NAMESIZE + PEER_BYTES];
        p->made[i] = links_unanswered(p->links); /* it may exist, without its alias */
        (void)snprintf(name, sizeof name, "%s%s", node->port, peer);
        return complain_link(p, "make", name, number);
    }
    p->made[i] = true;
    print_alias(alias, p->owner, node);
    number = links_set(p->links, node->port, alias);
    if (number != 0)
        return complain_link(p, "set the alias of", node->port, number);
    printf("made %s%s\n", node->port, peer);
    return true;
}

/* Does the step of the plan for a port. */
static bool carry_out(plan *p, size_t i)
{
    const char *port = p->config->nodes[i].port;
    int number = 0;

    if (p->steps[i] == STEP_REPLACE)
        number = links_remove(p->links, port);
    if (number != 0 && number != ENODEV)
        return complain_link(p, "remove", port, number);
    if (p->steps[i] == STEP_MAKE || p->steps[i] == STEP_REPLACE)
        return vcan_make(p, i);
    if (p->steps[i] == STEP_LEAVE)
        plain_print(stdout, "left %s to hardware: missing-port: wait\n", port);
    else if (p->steps[i] == STEP_SET_UP)
        number = links_set(p->links, port, NULL);
    else if (p->steps[i] == STEP_MTU)
        number = links_set_mtu(p->links, port, mtu_of(p, i));
    return number == 0 || complain_link(p, "set up", port, number);
}

/* Removes new interfaces again. One without an alias would seem to belong to somebody else. */
static void take_back(plan *p)
{
    for (size_t i = 0; i < p->config->node_count; i++) {
        const char *port = p->config->nodes[i].port;
        int number = p->made[i] ? links_remove(p->links, port) : ENODEV;
        if (number == 0)
            printf("removed %s again\n", port);
        else if (number != ENODEV)
            fprintf(stderr,
                    "canwire vcan: cannot remove %s again: %s (if it is there: ip link del %s)\n",
                    port, links_error(p->links), port);
    }
}

/* Plans all ports before anything is done: a port in the way leaves all as it is. */
static bool plan_ports(plan *p)
{
    bool good = true;

    for (size_t i = 0; i < p->config->node_count; i++)
        if (portname_is_interface(p->config->nodes[i].port))
            good = plan_port(p, i) && good;
    return good;
}

/* Does the planned steps. It stops at the first that fails, and the caller takes back the
 * others. */
static bool carry_out_all(plan *p)
{
    for (size_t i = 0; i < p->config->node_count; i++)
        if (portname_is_interface(p->config->nodes[i].port) && !carry_out(p, i))
            return false;
    return true;
}

/* Makes the interfaces of several buses, or none of them. */
static bool bring_up(plan *plans, size_t count)
{
    bool good = true;

    for (size_t i = 0; i < count; i++)
        good = plan_ports(&plans[i]) && good;
    for (size_t i = 0; good && i < count; i++)
        good = carry_out_all(&plans[i]);
    for (size_t i = 0; !good && i < count; i++)
        take_back(&plans[i]);
    return good;
}

/* ---- Down ------------------------------------------------------------------------------------ */

typedef struct name_list {
    const char *owner;
    size_t count;
    char (*names)[IF_NAMESIZE];
    bool used; /* a running bus has one */
    bool no_memory;
} name_list;

/* Tells of an interface that a running bus uses. */
static bool is_claimed(const link_info *info)
{
    char key[CLAIM_KEY_BYTES];
    claim_owner owner;
    claim_print_port(key, info->index);
    if (!claim_find(&owner, key))
        return false;
    plain_print(stderr,
                "canwire vcan: %s stays: it is in use by bus %s of canwired, pid %ld: stop it "
                "first\n",
                info->name, owner.name, owner.pid);
    return true;
}

/* Collects the interfaces of the file. One that canwired has claimed stays. */
static bool collect(void *user, const link_info *info)
{
    name_list *list = user;

    if (!is_ours(list->owner, info))
        return true;
    if (is_claimed(info)) {
        list->used = true;
        return true;
    }
    void *longer = realloc(list->names, (list->count + 1) * sizeof list->names[0]);
    list->no_memory = !longer;
    if (!longer)
        return false;
    list->names = longer;
    memcpy(list->names[list->count++], info->name, IF_NAMESIZE);
    return true;
}

/* Says that FILE has no interface. Without a file its name is a mistake, but for the unit, which
 * has known it. */
static bool tell_of_none(const char *file)
{
    struct stat found;
    if (!unit_instance() && stat(file, &found) != 0 && errno == ENOENT)
        return vcan_complain(file, "there is no such file, and no interface of it either");
    plain_print(stdout, "no interface of %s is there\n", file);
    return true;
}

/* Removes all interfaces that it can. FILE may be bad, or gone. */
static bool bring_down(const plan *p, const char *file)
{
    name_list list = {.owner = p->owner};
    int number = links_each(p->links, collect, &list);
    bool good = number == 0 && !list.no_memory;

    if (!good)
        (void)vcan_complain("interfaces", list.no_memory ? "out of memory" : links_error(p->links));
    for (size_t i = 0; i < list.count; i++) {
        number = links_remove(p->links, list.names[i]);
        if (number == 0)
            printf("removed %s\n", list.names[i]);
        else if (number != ENODEV) /* the other end of a removed one */
            good = complain_link(p, "remove", list.names[i], number);
    }
    free(list.names);
    if (good && list.count == 0 && !list.used)
        return tell_of_none(file);
    return good && !list.used;
}

/* Makes the interfaces of a configuration, or of the buses of a rig. */
static bool up(links *l, const char *owner, const cfg *const *buses, size_t count)
{
    plan *plans = calloc(count, sizeof *plans);

    if (!plans)
        return vcan_complain("interfaces", "out of memory");
    for (size_t i = 0; i < count; i++)
        plans[i] = (plan){
            .links = l, .owner = owner, .config = buses[i], .fd = cfg_fd_nodes(buses[i])};
    bool good = bring_up(plans, count);
    free(plans);
    return good;
}

/* Makes the interfaces of a configuration or of all buses of a rig. */
static bool up_file(links *l, const char *owner, const char *file)
{
    rig *several;
    cfg *one;
    (void)rig_load_either(&several, &one, &(cfg_file){.name = file}, stderr);
    bool good = several
                    ? up(l, owner, (const cfg *const *)several->buses, several->bus_count)
                    : one && up(l, owner, (const cfg *const *)&one, 1);

    rig_free(several);
    cfg_free(one);
    return good;
}

/* `down` goes by aliases alone, so FILE may be bad or gone. */
static int vcan_run(const char *verb, const char *file)
{
    char owner[PATH_MAX];

    if (!resolve(owner, file))
        return CLI_BAD_INPUT;
    links *l = links_open();
    bool good = l || vcan_complain("netlink", strerror(errno));
    if (good)
        good = strcmp(verb, "up") == 0 ? up_file(l, owner, file)
                                       : bring_down(&(plan){.links = l, .owner = owner}, file);
    links_close(l);
    return good ? CLI_OK : CLI_BAD_INPUT;
}

