/* SPDX-License-Identifier: MIT
 *
 * node.c - the keys of nodes, and of `defaults` for them.
 */
#include "config/parts.h"

#include "base/text/sametext.h"
#include "config/change/live.h"
#include "config/node/portname.h"
#include "config/node/tunnelname.h"
#include "config/source.h"
#include "config/change/retime.h"
#include "config/values.h"
#include "config/node/wake.h"

#include <net/if.h>
#include <stdio.h>
#include <string.h>

#define NETNS_NAME_MAX 64u
#define USB_SOCKETS "/run/canwire/"
#define USB_FRAMES 10u /* that the driver peak_usb has under way */
/* The default queue of a node with a port, but for usb, whose driver has one. Kernel ISO-TP writes
 * all 586 frames of 4095 bytes at once, J1939's transport protocol 255. Programs that do not wait,
 * such as scanners of CANopen, write a frame for each node. */
#define QUEUE_DEFAULT_PORT 1024u

static void check_interface(schema *self, const schema_key *key, const yaml_node_t *value,
                            const char *name, const char *netns);
static schema_reader read_peer_name, read_netns, read_usb_name, read_usb_socket;

const schema_key cfg_peer_keys[] = {
    {.name = "name", .read = read_peer_name, .required = true, .type = "interface",
     .help = "Interface that the ECU opens."},
    {.name = "netns", .read = read_netns, .type = "netns",
     .help = "Network namespace that it is in, by its name in `ip netns`. Default: that of the "
             "port."},
    {.name = NULL},
};

const schema_key cfg_usb_keys[] = {
    {.name = "usb", .read = read_usb_name, .required = true, .type = "interface",
     .help = "The CAN interface that the kernel's driver makes."},
    {.name = "netns", .read = read_netns, .type = "netns",
     .help = "Network namespace that it is in, by its name in `ip netns`. Default: that of the "
             "port."},
    {.name = "socket", .read = read_usb_socket, .type = "{'type': ['string', 'number']}",
     .help = "Where canwire-usb connects to canwired; default /run/canwire/INTERFACE.usb, with "
             "the namespace and a dot before the interface."},
    {.name = NULL},
};

static void check_peer(schema *self, const schema_key *key, const yaml_node_t *value,
                       const cfg_node *node);

/* Gives the ECU's interface the name of its node, by default with `vxcan`. */
static void name_peer(schema *self, const yaml_node_t *value, cfg_node *node)
{
    static const schema_key key = {.name = "peer"};

    if (portname_is_interface(node->name)) {
        node->peer = schema_copy(self, node->name);
        check_peer(self, &key, value, node);
    } else {
        schema_complain(self, value,
                        "peer: with vxcan an ECU's interface is called as its node, but '%s' is "
                        "too long for one (15 bytes); peer: NAME gives it another name",
                        node->name);
    }
}

/* Reads a node, which begins as what `defaults` say. */
static void read_node(schema *self, const schema_key *nodes, yaml_node_t *value, cfg_node *node)
{
    cfg_walk *walk = self->user;

    *node = walk->defaults;
    node->when_full = CFG_WHEN_FULL_DROP; /* without port */
    node->line = (int)value->start_mark.line + 1;
    schema_map_in(self, "node", value, nodes->map, nodes->within, node);
    if (cfg_is_usb(node) && node->queue < USB_FRAMES)
        schema_complain(self, value, "queue: a port usb needs %u or more, not %u", USB_FRAMES,
                        (unsigned)node->queue);
    walk->unnamed = walk->unnamed || *node->name == '\0';
    if (walk->config->vxcan && portname_is_interface(node->port) && *node->name && !node->peer)
        name_peer(self, value, node);
}

/* Reads the values of nodes that do not set their own. */
void cfg_read_defaults(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_walk *walk = self->user;

    (void)object;
    schema_map_in(self, key->name, value, key->map, key->within, &walk->defaults);
    if (value->type != YAML_MAPPING_NODE)
        return;
    walk->default_map = value;
    walk->default_order = schema_find(self, value, "order");
    walk->default_queue = schema_find(self, value, "queue");
    walk->default_when_full = schema_find(self, value, "when-full");
}

static void note_answers(cfg *config)
{
    for (size_t i = 0; i < config->node_count; i++)
        if (config->nodes[i].controller.mailbox_count > 0 || config->nodes[i].schedule.cycles > 0)
            config->has_answers = true;
}

/* Reads the list of nodes, and completes what needs all of them. Guests stand behind them. */
void cfg_read_nodes(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg *config = object;
    cfg_walk *walk = self->user;
    size_t count = schema_count(self, key, value, walk->guests ? 0 : 1, CW_NODES_MAX);

    walk->node_keys = key->map;
    const size_t room = walk->guests ? CW_NODES_MAX : count;
    config->nodes = schema_alloc(self, room + 1, sizeof *config->nodes);
    if (!config->nodes)
        return;
    for (; config->node_count < count; config->node_count++)
        read_node(self, key, schema_item(self, value, config->node_count),
                  &config->nodes[config->node_count]);
    cfg_add_guest(self, key->map);
    cfg_complete_controllers(self, value);
    cfg_complete_time(self, value);
    cfg_check_traffic(self, value);
    cfg_check_schedules(self, value);
    cfg_copy_guests(self);
    note_answers(config);
}

/* Names of nodes are unique on a bus: rules and clients go by them. */
void cfg_read_node_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg *config = cfg_of(self);
    cfg_node *node = object;
    char *name = cfg_read_name(self, key, value, NODE_NAME_MAX);

    if (!name)
        return;
    uint8_t other = cfg_find_node(config, name);
    if (other != CW_NO_NODE)
        schema_complain(self, value, "duplicate %s '%s' (also of the node in line %d)", key->name,
                        name, config->nodes[other].line);
    node->name = name;
}

/* Returns a copy of the name of an interface, or NULL without a text. */
static char *read_interface(schema *self, const schema_key *key, const yaml_node_t *value)
{
    const char *text = schema_text(self, key, value, PORTNAME_INTERFACE_EXPECTED);

    if (!text)
        return NULL;
    if (!portname_is_interface(text))
        schema_expected(self, key, value, PORTNAME_INTERFACE_EXPECTED);
    return schema_copy(self, text);
}

/* Resolves the path of a socket, which is relative to the file. kind: "unix:" or "usb:". */
static char *resolve_path(schema *self, const schema_key *key, const yaml_node_t *value,
                          const char *kind, const char *text)
{
    char *path = cfg_resolve_path(self, cfg_of(self)->file, text);
    char *port = path ? schema_alloc(self, strlen(kind) + strlen(path) + 1, 1) : NULL;

    if (!port)
        return NULL;
    strcpy(stpcpy(port, kind), path);
    if (strlen(path) > PORTNAME_PATH_MAX)
        schema_complain(self, value, "%s: the path of a socket has at most %u bytes, not %zu (%s)",
                        key->name, PORTNAME_PATH_MAX, strlen(path), path);
    return port;
}

static char *resolve_port(schema *self, const schema_key *key, const yaml_node_t *value,
                          const portname *name)
{
    return resolve_path(self, key, value, "unix:", name->path);
}

/* Reads the port of guests, which must be a socket that no other node has. */
static char *read_socket(schema *self, const schema_key *key, const yaml_node_t *value)
{
    static const char expected[] = "unix:PATH";
    const char *text = schema_text(self, key, value, expected);

    if (!text)
        return NULL;
    const portname name = portname_parse(text);
    if (name.kind == PORTNAME_UNIX) {
        char *port = resolve_port(self, key, value, &name);
        check_interface(self, key, value, port, NULL);
        return port;
    }
    schema_expected(self, key, value, expected);
    return NULL;
}

/* Complains about an address that is not that of one end. */
static void check_address(schema *self, const schema_key *key, const yaml_node_t *value,
                          const net_address *address)
{
    const char *many = address_of_many(address);
    if (many)
        schema_complain(self, value, "%s: %s is a %s address; expected that of one machine",
                        key->name, address->host, many);
}

/* Completes tcp:[HOST:]PORT by what is left out, so that equal ports have equal names. */
static char *complete_tcp(schema *self, const portname *name, const cfg_node *node)
{
    char text[PORTNAME_TCP_MAX];
    portname_print_tcp(text, name, node->name);
    return schema_copy(self, text);
}

/* Puts the name of a tunnel into its full form. */
static char *complete_tunnel(schema *self, const schema_key *key, const yaml_node_t *value,
                             const char *text)
{
    tunnelname name;
    char full[TUNNELNAME_BYTES];
    (void)tunnelname_parse(&name, text);
    if (!name.connects)
        check_address(self, key, value, &name.listen);
    if (name.has_peer)
        check_address(self, key, value, &name.peer);
    tunnelname_print(full, &name);
    return schema_copy(self, full);
}

/* Reads the name of a port and puts it into its full form, in which names can be compared. */
static char *read_port_name(schema *self, const schema_key *key, const yaml_node_t *value,
                            const cfg_node *node)
{
    char why[ADDRESS_WHY_BYTES];
    const char *text = schema_text(self, key, value, PORTNAME_EXPECTED);

    if (!text)
        return NULL;
    const portname name = portname_parse(text);
    if (portname_explain(why, text))
        schema_complain(self, value, "%s: %s", key->name, why);
    else if (name.kind == PORTNAME_INVALID)
        schema_expected(self, key, value, PORTNAME_EXPECTED);
    if (name.kind == PORTNAME_TCP) {
        check_address(self, key, value, &name.address);
        return complete_tcp(self, &name, node);
    }
    if (name.kind == PORTNAME_TUNNEL)
        return complete_tunnel(self, key, value, text);
    return name.kind == PORTNAME_UNIX ? resolve_port(self, key, value, &name)
                                      : schema_copy(self, text);
}

/* Returns true when a node has an interface of this name in this namespace. NULL is the namespace
 * of the ports. */
static bool has_interface(const cfg_node *node, const char *name, const char *netns)
{
    return (!netns && node->port && strcmp(node->port, name) == 0) ||
           (node->peer && strcmp(node->peer, name) == 0 && same_text(node->netns, netns));
}

/* Complains when an earlier node has this interface already. */
static void check_interface(schema *self, const schema_key *key, const yaml_node_t *value,
                            const char *name, const char *netns)
{
    const cfg *config = cfg_of(self);

    for (size_t i = 0; name && i < config->node_count; i++)
        if (has_interface(&config->nodes[i], name, netns)) {
            schema_complain(self, value, "duplicate %s '%s' (also of the node in line %d)",
                            key->name, name, config->nodes[i].line);
            return;
        }
}

static void read_usb_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;

    node->peer = read_interface(self, key, value);
}

/* The socket is written as a port is, since it takes the place of one. */
static void read_usb_socket(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    const char *text = schema_text(self, key, value, "the path of a socket");

    if (text)
        node->port = resolve_path(self, key, value, "usb:", text);
}

/* Returns the socket of an adapter without one of its own. */
static char *name_usb_socket(schema *self, const cfg_node *node)
{
    static const char folder[] = "usb:" USB_SOCKETS;
    const char *netns = node->netns ? node->netns : "";
    const size_t room = sizeof folder + strlen(netns) + strlen(".") + IFNAMSIZ + strlen(".usb");
    char *port = schema_alloc(self, room, 1);

    if (port)
        (void)snprintf(port, room, "%s%s%s%s.usb", folder, netns, *netns ? "." : "", node->peer);
    return port;
}

/* Reads `port: { usb: can0 }`. Its frames wait in the kernel, and leave in their order, as the
 * adapter has it. */
static void read_usb(schema *self, const schema_key *key, yaml_node_t *value, cfg_node *node)
{
    const cfg_walk *walk = self->user;

    node->when_full = CFG_WHEN_FULL_DROP;
    if (!walk->default_order)
        node->order = CW_ORDER_FIFO;
    schema_map(self, key->name, value, cfg_usb_keys, node);
    if (!node->peer)
        return;
    check_interface(self, key, value, node->peer, node->netns);
    if (!node->port)
        node->port = name_usb_socket(self, node);
    check_interface(self, key, value, node->port, NULL);
}

bool cfg_is_usb(const cfg_node *node)
{
    return node->port && portname_parse(node->port).kind == PORTNAME_USB;
}

/* Gives a node the defaults of one with a port. */
static void give_room(const cfg_walk *walk, cfg_node *node, cfg_when_full when_full)
{
    if (!walk->default_queue)
        node->queue = QUEUE_DEFAULT_PORT;
    node->when_full = walk->default_when_full ? walk->defaults.when_full : when_full;
}

/* Reads a port, and gives the node the queue that such a port needs. */
void cfg_read_port(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_walk *walk = self->user;
    cfg_node *node = object;

    node->port_place = cfg_place_of(value);
    if (value->type == YAML_MAPPING_NODE) {
        read_usb(self, key, value, node);
        return;
    }
    node->port = read_port_name(self, key, value, node);
    give_room(walk, node, portname_is_interface(node->port) ? CFG_WHEN_FULL_DROP
                                                            : CFG_WHEN_FULL_WAIT);
    check_interface(self, key, value, node->port, NULL);
}

/* Programs of guests wait for room by default: they speak to a socket. */
void cfg_read_guest_port(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_walk *walk = self->user;
    cfg_node *node = object;

    node->port_place = cfg_place_of(value);
    node->port = read_socket(self, key, value);
    give_room(walk, node, CFG_WHEN_FULL_WAIT);
}

/* Refuses the key where nobody could be held back, or the kernel does that. */
void cfg_read_when_full(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_node *node = object;

    if (!node->port)
        schema_complain(self, value, "%s: only a node with port can be held back", key->name);
    else if (cfg_is_usb(node))
        schema_complain(self, value, "%s: the kernel holds the frames of a port usb back",
                        key->name);
    schema_read_choice(self, key, value, object);
}

/* The interface must be another one than those of earlier nodes, and than the port itself. */
static void check_peer(schema *self, const schema_key *key, const yaml_node_t *value,
                       const cfg_node *node)
{
    check_interface(self, key, value, node->peer, node->netns);
    if (!node->netns && node->peer && same_text(node->peer, node->port))
        schema_complain(self, value, "duplicate %s '%s' (also its port)", key->name, node->peer);
}

/* Reads the other end of a pair of interfaces. */
void cfg_read_peer(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;

    if (!node->port)
        schema_complain(self, value, "%s: only a node with port has a peer", key->name);
    else if (!portname_is_interface(node->port))
        schema_complain(self, value, "%s: only a port that is an interface has a peer", key->name);
    if (value->type == YAML_SCALAR_NODE) /* short for { name: … } */
        read_peer_name(self, key, value, object);
    else
        schema_map(self, key->name, value, cfg_peer_keys, node);
    check_peer(self, key, value, node);
}

/* Sockets are made by canwired, so they are never missing. */
void cfg_read_missing_port(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    const cfg_node *node = object;

    if (!portname_is_interface(node->port))
        schema_complain(self, value, "%s: only a port that is an interface can be missing",
                        key->name);
    schema_read_choice(self, key, value, object);
}

bool cfg_waits_for_port(const cfg *config, const cfg_node *node)
{
    const bool own = node->missing_port != CFG_MISSING_PORT_UNSET;

    return (own ? node->missing_port : config->missing_port) == CFG_MISSING_PORT_WAIT;
}

static void read_peer_name(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;

    node->peer = read_interface(self, key, value);
}

/* The name becomes a part of a path, so it has no slash and no dot in front. */
static void read_netns(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    static const char expected[] = "the name of a network namespace as in `ip netns`";
    cfg_node *node = object;
    const char *text = schema_text(self, key, value, expected);

    if (!text)
        return;
    if (strlen(text) > NETNS_NAME_MAX || strpbrk(text, "/ \t\r\n") || text[0] == '.')
        schema_expected(self, key, value, expected);
    node->netns = schema_copy(self, text);
}

/* A key turns one mode on or off; others stay as `defaults` have them. */
void cfg_read_mode(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    const uint8_t mode = (uint8_t)cfg_live_of(key)->which;
    bool on;

    if (!schema_choose_bool(self, &on, key, value))
        return;
    node->modes = (uint8_t)(on ? node->modes | mode : node->modes & ~mode);
    node->berr_reporting = node->modes & CW_MODE_BERR_REPORTING;
}

/* The short form of `kind`, as `ip link` has it. */
void cfg_read_fd(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    bool on;

    if (schema_choose_bool(self, &on, key, value))
        node->kind = on ? CFG_KIND_FD : CFG_KIND_CLASSICAL;
}

/* The member is the opposite of the key, so that all zeros is the usual node. */
void cfg_read_exception(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_node *node = object;
    bool on;

    if (schema_choose_bool(self, &on, key, value))
        node->no_exception = !on;
}

void cfg_read_wake(schema *self, const schema_key *key, yaml_node_t *value, void *object)
{
    cfg_wake_read_into(self, key, value, &((cfg_node *)object)->sleep);
}
