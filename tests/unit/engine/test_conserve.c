/* SPDX-License-Identifier: MIT
 *
 * test_conserve.c - the books of frames between ports and bus, with ports that only count.
 */
#include "rig.h"

#include "engine/conserve.h"
#include "engine/reload.h"
#include "engine/share.h"
#include "port/open.h"

struct port {
    port_stats stats;
};

void port_get_stats(port *p, port_stats *stats)
{
    *stats = p->stats;
}

port *port_open(const char *interface, const char *bus, char error[PORT_ERROR_TEXT_MAX])
{
    (void)interface;
    (void)bus;
    (void)error;
    return NULL;
}

void share_port(port *p, const cfg *config, unsigned node)
{
    (void)p;
    (void)config;
    (void)node;
}

port *door_open(const char *name, char error[PORT_ERROR_TEXT_MAX])
{
    (void)name;
    (void)error;
    return NULL;
}

bool port_exists(const char *interface)
{
    (void)interface;
    return false;
}

void port_close(port *p)
{
    (void)p;
}

/* Writes a frame of a node's ECU, which comes onto the bus. */
static void write_one(rig *r, port *p, unsigned node)
{
    const cw_frame frame = rig_frame(0x123, 0, 0);
    p->stats.read++;
    rig_send(r, node, &frame, 0);
}

TEST(balance_through_exchanges_of_ports)
{
    static const uint8_t swapped[CW_NODES_MAX] = {1, 0, [2 ... CW_NODES_MAX - 1] = CW_NO_NODE};
    port a = {.stats.written = 0};
    port b = {.stats.written = 0};
    conserve c = {.nodes[0].released = 0};
    port_stats s;
    RIG *r = rig_new(2);
    rig_start(r);
    conserve_opened(&c, 0, &a);
    conserve_opened(&c, 1, &b);
    write_one(r, &a, 0);
    assert_true(conserve_balances(&c, r->bus, 0, &a));
    rig_run_bits(r, 200);
    assert_false(conserve_balances(&c, r->bus, 1, &b));
    b.stats.written++; /* the frame that it has received */
    assert_true(conserve_balances(&c, r->bus, 1, &b));

    /* each node gets the other's port, and its counters begin there */
    conserve_closing(&c, 0, &a);
    conserve_closing(&c, 1, &b);
    conserve_opened(&c, 0, &b);
    conserve_opened(&c, 1, &a);
    assert_true(conserve_balances(&c, r->bus, 0, &b) && conserve_balances(&c, r->bus, 1, &a));
    write_one(r, &b, 0);
    rig_run_bits(r, 400);
    a.stats.write_failed++;
    conserve_get_stats(&s, &c, 1, &a);
    assert_int_equal(s.written, 1);
    assert_int_equal(s.write_failed, 1);
    assert_int_equal(s.read, 0);
    conserve_get_stats(&s, &c, 0, &b);
    assert_int_equal(s.read, 2);
    assert_int_equal(s.written, 0);
    assert_true(conserve_balances(&c, r->bus, 0, &b) && conserve_balances(&c, r->bus, 1, &a));

    /* nodes change places, their books with them */
    conserve_remap(&c, swapped);
    conserve_get_stats(&s, &c, 0, &a);
    assert_int_equal(s.written + s.write_failed, 2);
    assert_false(conserve_balances(&c, r->bus, 0, &a)); /* the bus does not know of it */
}

TEST(a_port_that_is_gone_and_one_that_never_was)
{
    const cw_frame frame = rig_frame(0x123, 0, 0);
    port a = {.stats.written = 0};
    conserve c = {.nodes[0].released = 0};
    port_stats s;
    RIG *r = rig_new(3);
    rig_start(r);
    conserve_opened(&c, 0, &a);
    write_one(r, &a, 0);
    conserve_closing(&c, 0, &a);
    assert_true(conserve_balances(&c, r->bus, 0, NULL)); /* its frame is in the inbox */
    rig_send(r, 2, &frame, 500 * BIT);
    assert_false(conserve_balances(&c, r->bus, 2, NULL));
    c.nodes[2].released++;
    assert_true(conserve_balances(&c, r->bus, 2, NULL));
    rig_run_bits(r, 1000);
    conserve_missed(&c, 0, true);
    conserve_get_stats(&s, &c, 0, NULL);
    assert_int_equal(s.write_failed, 1);
    for (unsigned i = 1; i < 3; i++)
        for (uint64_t k = 0; k < rig_stats(r, i).rx_frames; k++)
            conserve_missed(&c, i, false);
    for (unsigned i = 0; i < 3; i++)
        assert_true(conserve_balances(&c, r->bus, i, NULL));
    conserve_get_stats(&s, &c, 2, NULL);
    assert_int_equal(s.write_failed, 0);
}

TEST(every_node_that_does_not_balance_is_counted)
{
    cfg_node nodes[] = {{.name = (char[]){"a"}}, {.name = (char[]){"b"}}, {.name = (char[]){"c"}}};
    const cfg config = {.node_count = 3, .nodes = nodes};
    port *ports[3] = {NULL};
    conserve c = {.nodes[0].released = 0};
    RIG *r = rig_new(3);
    rig_start(r);
    assert_int_equal(conserve_check(&c, &config, r->bus, ports), 0);
    c.nodes[0].released = 1;
    c.nodes[2].unheard = 1;
    assert_int_equal(conserve_check(&c, &config, r->bus, ports), 2);
}
