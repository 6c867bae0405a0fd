/* SPDX-License-Identifier: MIT
 *
 * test_engine_links.c - nodes join and leave the bus by the reports of rtnetlink about interfaces.
 * Kernel, ports and bus are minimal fakes.
 */
#include "cases.h"
#include "config/node/portname.h"
#include "engine/core.h"
#include "engine/share.h"
#include "port/open.h"

#include <errno.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#define LINKS 3u
#define NODES 4u
#define UP_FLAGS (IFF_UP | 0x10000u) /* IFF_LOWER_UP */

/* ---- The kernel ------------------------------------------------------------------------------ */

static struct {
    const char *links[LINKS]; /* all up; NULL: there is none; the index is one more */
    unsigned requests;        /* that have not been answered */
    int send_error;           /* of requests; 0: none */
    int sockets[2];           /* of the daemon, of the kernel */
} kernel;

int socket(int domain, int type, int protocol)
{
    assert_int_equal(domain, AF_NETLINK);
    assert_int_equal(protocol, NETLINK_ROUTE);
    (void)type;
    assert_int_equal(socketpair(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0, kernel.sockets), 0);
    return kernel.sockets[0];
}

int bind(int fd, __CONST_SOCKADDR_ARG address, socklen_t size)
{
    (void)fd;
    (void)address;
    (void)size;
    return 0;
}

ssize_t send(int fd, const void *data, size_t size, int flags)
{
    const struct nlmsghdr *request = data;
    (void)flags;
    assert_int_equal(fd, kernel.sockets[0]);
    assert_int_equal(request->nlmsg_type, RTM_GETLINK);
    if (kernel.send_error) {
        errno = kernel.send_error;
        return -1;
    }
    kernel.requests++;
    return (ssize_t)size;
}

static void answer(const void *bytes, size_t size)
{
    assert_int_equal(write(kernel.sockets[1], bytes, size), size);
}

static void answer_link(unsigned link)
{
    struct {
        struct nlmsghdr header;
        struct ifinfomsg info;
        struct rtattr attribute;
        char name[IF_NAMESIZE];
    } packet = {
        .header = {.nlmsg_len = sizeof packet, .nlmsg_type = RTM_NEWLINK,
                   .nlmsg_flags = NLM_F_MULTI},
        .info = {.ifi_index = (int)link + 1, .ifi_flags = UP_FLAGS},
        .attribute = {.rta_len = RTA_LENGTH(IF_NAMESIZE), .rta_type = IFLA_IFNAME},
    };
    strncpy(packet.name, kernel.links[link], IF_NAMESIZE - 1);
    answer(&packet, sizeof packet);
}

/* Answers with NLMSG_DONE or NLMSG_ERROR, with 0 or a negative number of an error. */
static void answer_end(uint16_t type, int error)
{
    struct {
        struct nlmsghdr header;
        struct nlmsgerr body;
    } packet = {
        .header = {.nlmsg_len = sizeof packet, .nlmsg_type = type},
        .body = {.error = error},
    };
    answer(&packet, sizeof packet);
}

/* Answers with the requested list, up to a link, and its end. */
static void answer_list(unsigned links, uint16_t type, int error)
{
    assert_int_equal(kernel.requests, 1);
    kernel.requests = 0;
    for (unsigned i = 0; i < links; i++)
        if (kernel.links[i])
            answer_link(i);
    answer_end(type, error);
}

/* ---- Configurations -------------------------------------------------------------------------- */

#define NODE_A {.name = (char[]){"a"}, .port = (char[]){"vcan0"}}
#define NODE_B {.name = (char[]){"b"}, .port = (char[]){"vcan1"}}
#define NODE_C {.name = (char[]){"c"}, .port = (char[]){"unix:/run/c.sock"}}
#define NODE_D {.name = (char[]){"d"}}

static cfg_node as_started[NODES] = {NODE_A, NODE_B, NODE_C, NODE_D};
static cfg_node exchanged[NODES] = {NODE_C, NODE_B, NODE_A, NODE_D};
static const cfg configs[] = {
    {.bus_name = (char[]){"links"}, .node_count = NODES, .nodes = as_started},
    {.bus_name = (char[]){"links"}, .node_count = NODES, .nodes = exchanged},
};

/* ---- Ports and bus --------------------------------------------------------------------------- */

struct port {
    unsigned index;
};

static struct {
    unsigned open_ports;
    unsigned opened; /* so far */
    bool attached[NODES];
    unsigned reloads; /* that are ready, one for each update */
    unsigned mtu; /* of all interfaces */
    unsigned short_bytes; /* missing room of a port that is asked */
} bus;

static unsigned index_of(const char *name)
{
    for (unsigned i = 0; i < LINKS; i++)
        if (kernel.links[i] && strcmp(kernel.links[i], name) == 0)
            return i + 1;
    return 0;
}

bool port_exists(const char *name)
{
    return !portname_is_interface(name) || index_of(name) != 0;
}

port *port_open(const char *name, const char *of, char error[PORT_ERROR_TEXT_MAX])
{
    (void)of;
    (void)error;
    assert_true(port_exists(name));
    port *p = calloc(1, sizeof *p);
    assert_non_null(p);
    p->index = index_of(name);
    bus.open_ports++;
    bus.opened++;
    return p;
}

void share_port(port *p, const cfg *config, unsigned node)
{
    (void)p;
    (void)config;
    (void)node;
}

void port_close(port *p)
{
    bus.open_ports--;
    free(p);
}

unsigned port_index(const port *p)
{
    return p->index;
}

void port_count_loopless(port *p, int64_t least, int64_t most, bool counting)
{
    (void)p;
    (void)least;
    (void)most;
    (void)counting;
}

unsigned port_mtu(const port *p)
{
    return p->index > 0 ? bus.mtu : 0;
}

unsigned port_buffer_bytes(const port *p)
{
    (void)p;
    return PORT_BUFFER_BYTES - bus.short_bytes;
}

void conserve_opened(conserve *c, unsigned node, port *opened)
{
    (void)c;
    (void)node;
    (void)opened;
}

void conserve_closing(conserve *c, unsigned node, port *closing)
{
    (void)c;
    (void)node;
    (void)closing;
}

void inputs_attach(inputs *in, unsigned node, bool on)
{
    (void)in;
    bus.attached[node] = on;
}

void engine_keep_settings(engine *e, unsigned node)
{
    (void)e;
    (void)node;
}

void engine_read_rest(engine *e, unsigned node)
{
    (void)e;
    (void)node;
}

void engine_watch_port(engine *e, unsigned node)
{
    (void)e;
    (void)node;
}

void engine_unwatch_port(engine *e, unsigned node)
{
    (void)e;
    (void)node;
}

/* Exchanges the places of two nodes by a reload: one has an interface and one has none. */
static void wake(engine *e)
{
    static const reload exchange = {.port_from = {2, 1, 0, 3}};
    port *first = e->now.ports[0];
    if (bus.reloads == 0)
        return;
    bus.reloads--;
    e->now.ports[0] = e->now.ports[2];
    e->now.ports[2] = first;
    e->config = e->config == &configs[0] ? &configs[1] : &configs[0];
    engine_carry_links_over(e, &exchange);
}

/* ---- Start and end --------------------------------------------------------------------------- */

/* Starts with two interfaces; the first list has been requested. */
static engine *start(void)
{
    memset(&kernel, 0, sizeof kernel);
    memset(&bus, 0, sizeof bus);
    kernel.links[0] = "vcan0";
    kernel.links[1] = "vcan1";
    engine *e = calloc(1, sizeof *e);
    assert_non_null(e);
    e->loop = ev_loop_new(EVFLAG_AUTO);
    e->wake = wake;
    e->config = &configs[0];
    memset(bus.attached, true, sizeof bus.attached);
    assert_true(engine_open_ports(e));
    assert_int_equal(bus.opened, 3);
    assert_true(engine_watch_links(e));
    return e;
}

static void end(engine *e)
{
    engine_unwatch_links(e);
    (void)close(kernel.sockets[1]);
    for (unsigned i = 0; i < NODES; i++)
        if (e->now.ports[i])
            port_close(e->now.ports[i]);
    assert_int_equal(bus.open_ports, 0);
    ev_loop_destroy(e->loop);
    free(e);
}

static void read_answers(engine *e)
{
    ev_run(e->loop, EVRUN_NOWAIT);
}

/* Compares links by place: U(p), D(own), M(issing), or - for none. */
static void assert_links(const engine *e, const char *expected)
{
    static const char letters[] = {[REPORT_NO_LINK] = '-', [REPORT_LINK_UP] = 'U',
                                   [REPORT_LINK_DOWN] = 'D', [REPORT_LINK_MISSING] = 'M'};
    char text[NODES + 1] = "";
    for (unsigned i = 0; i < NODES; i++) {
        report_link state = e->links.state[i];
        text[i] = letters[state];
        assert_int_equal(bus.attached[i], state == REPORT_NO_LINK || state == REPORT_LINK_UP);
        assert_int_equal(e->now.ports[i] != NULL, state == REPORT_LINK_UP);
    }
    assert_string_equal(text, expected);
}

/* ---- Tests ----------------------------------------------------------------------------------- */

TEST(who_is_not_in_the_list_leaves_and_comes_back)
{
    engine *e = start();
    answer_list(LINKS, NLMSG_DONE, 0);
    read_answers(e);
    assert_links(e, "UUU-");
    kernel.links[1] = NULL;
    linkwatch_list(e->links.watch);
    answer_list(LINKS, NLMSG_DONE, 0);
    read_answers(e);
    assert_links(e, "UMU-");
    kernel.links[2] = "vcan1";
    answer_link(2);
    read_answers(e);
    assert_links(e, "UUU-");
    assert_int_equal(bus.opened, 4);
    end(e);
}

/* The list has no changes, so only its end advances the bus to the present. */
TEST(a_reload_that_is_over_in_the_end_of_a_list)
{
    engine *e = start();
    bus.reloads = 2;
    for (unsigned lists = 0; lists < 3; lists++) {
        answer_list(LINKS, NLMSG_DONE, 0);
        read_answers(e);
        assert_links(e, "UUU-");
    }
    assert_int_equal(bus.reloads, 0);
    assert_int_equal(kernel.requests, 0);
    assert_int_equal(bus.opened, 3);
    end(e);
}

/* The list that the reload asks for shows changes up to then. */
TEST(an_interface_that_goes_during_such_a_reload)
{
    engine *e = start();
    bus.reloads = 1;
    kernel.links[0] = NULL;
    answer_list(LINKS, NLMSG_DONE, 0);
    read_answers(e);
    assert_int_equal(bus.reloads, 0);
    answer_list(LINKS, NLMSG_DONE, 0);
    read_answers(e);
    assert_links(e, "UUM-");
    end(e);
}

/* Rings the timer, which takes too long otherwise. */
static void ring(engine *e)
{
    assert_true(ev_is_active(&e->links.retry));
    ev_invoke(e->loop, &e->links.retry, EV_TIMER);
}

/* A list can end without reporting all interfaces. */
TEST(a_list_that_fails_is_asked_for_again)
{
    static const struct {
        unsigned links;
        uint16_t type;
    } cases[] = {{0, NLMSG_ERROR}, {0, NLMSG_DONE}, {1, NLMSG_DONE}, {1, NLMSG_ERROR}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        engine *e = start();
        for (unsigned times = 0; times < 3; times++) {
            answer_list(cases[i].links, cases[i].type, -ENOMEM);
            read_answers(e);
            assert_links(e, "UUU-");
            assert_int_equal(kernel.requests, 0);
            ring(e);
        }
        kernel.links[1] = NULL;
        answer_list(LINKS, NLMSG_DONE, 0);
        read_answers(e);
        assert_links(e, "UMU-");
        assert_false(ev_is_active(&e->links.retry));
        end(e);
    }
}

TEST(a_list_that_cannot_be_asked_for)
{
    engine *e = start();
    answer_list(LINKS, NLMSG_DONE, 0);
    read_answers(e);
    kernel.send_error = ENOBUFS;
    kernel.links[0] = NULL;
    linkwatch_list(e->links.watch);
    ring(e);
    assert_links(e, "UUU-");
    kernel.send_error = 0;
    ring(e);
    answer_list(LINKS, NLMSG_DONE, 0);
    read_answers(e);
    assert_links(e, "MUU-");
    end(e);
}

/* Messages after a failed list do not belong to another one. */
TEST(an_end_without_a_list)
{
    engine *e = start();
    answer_list(0, NLMSG_ERROR, -ENOMEM);
    answer_end(NLMSG_DONE, 0);
    read_answers(e);
    assert_links(e, "UUU-");
    ring(e);
    answer_list(LINKS, NLMSG_DONE, 0);
    answer_end(NLMSG_ERROR, -EBUSY);
    read_answers(e);
    assert_links(e, "UUU-");
    assert_false(ev_is_active(&e->links.retry));
    end(e);
}

/* The list was one of the nodes before the reload. */
TEST(a_reload_in_the_end_of_a_list_that_cannot_ask_for_another)
{
    engine *e = start();
    bus.reloads = 1;
    kernel.send_error = ENOBUFS;
    answer_list(LINKS, NLMSG_DONE, 0);
    read_answers(e);
    assert_links(e, "UUU-");
    kernel.send_error = 0;
    ring(e);
    kernel.links[1] = NULL;
    answer_list(LINKS, NLMSG_DONE, 0);
    read_answers(e);
    assert_links(e, "UMU-");
    end(e);
}

/* Also of a port that is opened later. */
TEST(too_little_room_is_told)
{
    engine *e = start();
    kernel.links[1] = NULL;
    answer_list(LINKS, NLMSG_DONE, 0);
    read_answers(e);
    assert_false(e->links.reported_small);
    bus.short_bytes = 1;
    kernel.links[1] = "vcan1";
    answer_link(1);
    read_answers(e);
    assert_links(e, "UUU-");
    assert_true(e->links.reported_small);
    end(e);
}
